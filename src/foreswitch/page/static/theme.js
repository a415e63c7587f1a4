// Before the first paint: the colours chosen last time. They belong to the reader, not to the link.
{
  const theme = localStorage.getItem("foreswitch.theme");
  if (theme === "light" || theme === "dark") document.documentElement.dataset.theme = theme;
}
