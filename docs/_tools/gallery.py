"""The examples, run: each one's text, what its script printed and drew, its files."""

from __future__ import annotations

import re
from pathlib import Path

from processes import ended, started

ROOT = Path(__file__).resolve().parents[2]


def examples() -> list[Path]:
    """Folders of examples with a script and a text; the paper's plant first."""
    found = [script.parent for script in (ROOT / "examples").glob("*/run.py") if (script.parent / "README.md").exists()]
    return sorted(found, key=lambda folder: (folder.name != "hot_gas", folder.name))


def run_examples(folder: Path) -> None:
    """Run every example into a folder of its own; what it prints goes beside its pictures."""
    folders = {example: folder / example.name for example in examples()}
    scripts = {str(each / "run.py"): (out, [str(each / "run.py"), str(out)]) for each, out in folders.items()}
    for printed, out in zip(ended(started(scripts)).values(), folders.values(), strict=True):
        (out / "printed.txt").write_text(printed)


def example_text(example: Path, out: Path) -> str:
    """An example's README as part of a page: headings one level down, pictures and files from where they are now."""

    def link(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        name = Path(target).name
        if picture:
            drawn = out / name
            vector = drawn.with_suffix(".svg")
            found = vector if vector.exists() else drawn
            if not found.exists():
                raise ValueError(f"{example.name}/README.md shows {target}, which run.py does not draw")
            return f"![{words}](/_generated/gallery/{example.name}/{found.name})"
        if target.startswith("../../docs/"):
            return f"[{words}](../{target.removeprefix('../../docs/')})"
        if not target.startswith(("http", "#")) and (example / target).is_file():
            return f"{{download}}`{words.strip('`')} <../../examples/{example.name}/{target}>`"
        return match[0]

    pieces = re.split(
        r"^(```.*?^```$)", (example / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    for i in range(0, len(pieces), 2):  # fenced blocks, at odd places, stay as they are
        deeper = re.sub(r"^#", "##", pieces[i], flags=re.MULTILINE)
        pieces[i] = re.sub(r"(!?)\[([^\]]*)\]\(([^)]+)\)", link, deeper)
    return "".join(pieces)


def gallery_page(folder: Path) -> str:
    """Each example: its text, what its script printed and drew, its files."""
    parts = []
    for example in examples():
        name, out = example.name, folder / example.name
        text = example_text(example, out)
        parts.append(text)
        drawn = sorted(out.glob("*.svg"), key=lambda path: (path.stem != "picture", path.stem))
        shown = [f"/_generated/gallery/{name}/{path.name}" for path in drawn]
        parts += [f"![{path.stem}]({where})" for path, where in zip(drawn, shown, strict=True) if where not in text]
        printed = (out / "printed.txt").read_text()
        if printed.strip() not in text:
            parts += [f"`examples/{name}/run.py` prints:", f"```text\n{printed}```"]
        files = sorted(path.name for path in example.iterdir() if path.suffix in (".toml", ".py", ".csv"))
        parts.append(
            "Files: " + ", ".join(f"{{download}}`{each} <../../examples/{name}/{each}>`" for each in files) + "."
        )
    return "\n\n".join(parts) + "\n"
