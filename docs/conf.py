"""The site: `make site`. Sphinx reads this file; what it makes itself is in `_site`."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from _site import gallery, notebooks, reference  # noqa: E402

import gramian  # noqa: E402

project = "gramian"
author = "the gramian authors"
project_copyright = "the gramian authors, MIT or Apache-2.0"
version = release = gramian.__version__

extensions = [
    "myst_nb",  # pages in Markdown, their cells run at the build
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",  # docstrings in numpydoc form
    "sphinx_design",  # cards and grids of the landing page
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",  # runs the examples and takes their pictures
    "_site.mathml",  # formulas that need no network
    "_site.names",
]
exclude_patterns = [
    "_site",
    "tutorials/notebooks",
    "gallery/**/*.ipynb",
    "gallery/**/*.py",
    "**/sg_execution_times*",
]
source_suffix = {".md": "myst-nb", ".rst": "restructuredtext"}

# Markdown. A cell that fails, fails the build.
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4
nb_execution_mode = "force"  # a cache would not see that the package changed
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
nb_ipywidgets_js = {}

# Docstrings. Their types say more than the annotations, and are shorter.
default_role = "name"
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_inherit_docstrings = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_use_admonition_for_examples = False
add_module_names = False
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"

# The gallery.
sphinx_gallery_conf = gallery.CONF

# The looks: furo has no network in it, works at 390 px and has a dark mode.
html_theme = "furo"
pygments_style = "tango"
pygments_dark_style = "github-dark"
html_title = f"gramian {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
# Summaries of hits are fetched page by page, which a browser refuses for files.
html_show_search_summary = False
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#0b5c9c",
        "color-brand-content": "#0b5c9c",
        "font-stack": "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', sans-serif",
        "font-stack--monospace": "ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace",
    },
    "dark_css_variables": {
        "color-brand-primary": "#6cb6f5",
        "color-brand-content": "#6cb6f5",
    },
}
templates_path = []


def setup(app):
    """Have the generated pages written before any page is read."""
    app.connect("builder-inited", reference.write)
    app.connect("builder-inited", notebooks.write)
