"""How the site is built: `python -m sphinx -W --keep-going -b html docs docs/_build/html`.

Nothing is fetched: equations become MathML, figures are made by the library, and what was run
before comes out of a cache (`_build/.jupyter_cache` for notebooks, `gallery` for examples).
"""

from __future__ import annotations

import os
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path[:0] = [str(DOCS / "_ext"), str(ROOT)]

from example_gallery import ORDER, runs  # noqa: E402  (lies in _ext)

# kernels and workers take the checkout, one core, and tables of 80 columns
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
os.environ["COLUMNS"] = "80"
os.environ["JUPYTER_PLATFORM_DIRS"] = "1"
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(DOCS / "_build" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
os.environ.pop("MPLBACKEND", None)  # a notebook's kernel has its own

project = "diffthrust"
author = "The diffthrust developers"
project_copyright = "the diffthrust developers"
release = installed_version("diffthrust")
version = ".".join(release.split(".")[:2])

extensions = [
    "myst_nb",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    # of this folder
    "code_links",
    "example_gallery",
    "mathml",
    "reference_pages",
    "atlas_pages",
]
exclude_patterns = ["_build", "_ext", "gallery/*.ipynb", "gallery/*.py", "gallery/*.json"]
suppress_warnings = ["config.cache"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3

nb_execution_mode = "cache"
nb_execution_cache_path = str(DOCS / "_build" / ".jupyter_cache")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

sphinx_gallery_conf = {
    "examples_dirs": str(ROOT / "examples"),
    "gallery_dirs": "gallery",
    "filename_pattern": rf"/({'|'.join(name for name in ORDER if runs(name))})\.py$",
    "ignore_pattern": r"_data\.py",
    "within_subsection_order": "example_gallery.place",
    "image_scrapers": ("example_gallery.saved_figures",),
    "reset_argv": "example_gallery.output_folder",
    "capture_repr": (),
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "inspect_global_variables": False,
    "min_reported_time": 0,
    "default_thumb_file": str(DOCS / "_static" / "text_only.png"),
    "log_level": {"backreference_missing": "debug"},
}

highlight_language = "none"
smartquotes = False  # options begin with two hyphens

html_theme = "pydata_sphinx_theme"
html_title = f"diffthrust {release}"
html_static_path = ["_static"]
html_css_files = ["diffthrust.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "diffthrust"},
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
html_sidebars = {"index": [], "**": ["sidebar-nav-bs"]}

# where several versions stand side by side the workflow says which of them this is
if "DIFFTHRUST_DOCS_VERSION" in os.environ:
    html_theme_options |= {
        "switcher": {
            "json_url": "../switcher.json",
            "version_match": os.environ["DIFFTHRUST_DOCS_VERSION"],
        },
        "check_switcher": False,
        "navbar_end": ["version-switcher", "theme-switcher"],
    }
