"""The configuration of sphinx-gallery: which scripts, and where their pictures are."""

from pathlib import Path

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

ROOT = Path(__file__).parents[2]


class Pictures:
    """Take the figures that a script has in its variables; ours are not pyplot's."""

    def __repr__(self):
        """Be the same in each build: sphinx compares configurations by their text."""
        return "Pictures"

    def __call__(self, block, variables, conf):
        """Save what is new, and give the text that shows it."""
        seen = variables.setdefault("_pictures", set())
        paths = []
        for value in list(variables["example_globals"].values()):
            if isinstance(value, Figure) and id(value) not in seen:
                seen.add(id(value))
                path = next(variables["image_path_iterator"])
                value.savefig(path, dpi=110)
                paths.append(path)
        return figure_rst(paths, conf["src_dir"])


CONF = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"make_|car_passes|compiled_estimator|monte_carlo_cluster",
    "image_scrapers": (Pictures(),),
    "capture_repr": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "thumbnail_size": (480, 300),
    "within_subsection_order": "FileNameSortKey",
    "reset_modules": (),
}
