"""The documentation site: `make docs` builds it in build/docs; nothing on it asks another server."""

from importlib.metadata import version as version_of

project = "push-recovery"
author = "The push-recovery authors"
copyright = "the push-recovery authors"  # noqa: A001  # the name that Sphinx reads
version = release = version_of("push-recovery")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx-mathjax-offline"]
exclude_patterns = ["README.md"]  # the list of pages for those who read the files; index.md is the site's
html_theme = "furo"
html_title = "push-recovery"
html_theme_options = {"footer_icons": []}
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["site.css"]

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]  # code hosts draw such a block as an equation, too
myst_heading_anchors = 4

add_module_names = False  # all of them are imported from push_recovery itself
autodoc_member_order = "bysource"
autodoc_typehints = "description"


def _escape_bars(app, what, name, obj, options, lines):
    """|F| is a size in this project's docstrings, and a substitution in reStructuredText."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def setup(app):
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _escape_bars)
