"""Where things stand in the repository."""

from pathlib import Path

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
CORE, DOCS, EXAMPLES = ROOT / "core", ROOT / "docs", ROOT / "examples"
VECTORS = sorted((TESTS / "vectors").glob("*.json"))
