"""Draw the pictures of the README and of the model pages anew: python docs/make_pictures.py.

They are those of examples in the gallery.
"""

import runpy
from pathlib import Path

HERE = Path(__file__).parent
PICTURES = {
    "demo": "tracking/three_ships",
    "bearings_family": "tracking/same_bearings",
    "bearings_power": "tracking/power_of_the_test",
}

if __name__ == "__main__":
    for name, example in PICTURES.items():
        space = runpy.run_path(str(HERE.parent / "examples" / f"{example}.py"))
        space["picture"].savefig(HERE / "img" / f"{name}.png", dpi=110)
