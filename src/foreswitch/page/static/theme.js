// Before the first paint: the colours chosen last time. They belong to the reader, not to the link.
{
  let theme = null;
  try {
    theme = localStorage.getItem("foreswitch.theme");
  } catch {
    // storage is blocked
  }
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
}
