"""Sphinx configuration. Tables, help texts, pictures and numbers come from the code, see _tools/generate.py."""

import importlib.metadata
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_tools"))

import generate  # noqa: E402  (needs the path above)

generate.build(HERE / "_generated")

project = "foreswitch"
author = "the foreswitch authors"
copyright = author  # Sphinx asks for this name
release = importlib.metadata.version("foreswitch")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "formulas"]
exclude_patterns = ["_build", "_generated", "_tools"]
default_role = "py:obj"

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say it, with shapes and units
napoleon_google_docstring = False
napoleon_use_param = False  # else words of a type link to whatever has that name
napoleon_use_ivar = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"foreswitch {release}"
html_math_renderer = "mathtext"
html_static_path = ["static"]
html_css_files = ["style.css"]
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False
