"""Draw the pictures of bearings-only observability: python docs/make_bearings_pictures.py."""

from pathlib import Path

import gramian as gm

IMAGES = Path(__file__).parent / "img"


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    gm.bearings.family_figure().savefig(IMAGES / "bearings_family.png")
    gm.bearings.power_figure(trials=5000).savefig(IMAGES / "bearings_power.png")


if __name__ == "__main__":
    main()
