"""What Sphinx is told: pages in Markdown, formulas as MathML, reference from docstrings, no network."""

from __future__ import annotations

from importlib.metadata import version as installed

project = "seatrial"
author = "The seatrial contributors"
release = version = installed("seatrial")
html_title = f"seatrial {release}"

extensions = ["docs.site.formulas", "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_math_renderer = "mathml"
source_suffix = {".md": "markdown"}
exclude_patterns = ["site"]

# Markdown as the pages are written: $formulas$, anchors of headings as on GitHub.
myst_enable_extensions = ["dollarmath"]
myst_dmath_double_inline = True
myst_heading_anchors = 4
myst_links_external_new_tab = False

# Docstrings name code in single backticks.
default_role = "code"
suppress_warnings = ["ref.python"]  # "position" in a table of attributes is a word there, no reference
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "monokai"
