"""Build from the sdist: python tests/wheel/try_sdist.py FOLDER MATURIN

Unpacks the sdist away from the checkout and builds a wheel from it, with the profile
of the demo, which compiles faster: it proves that no file is missing. The wheel is installed
into an empty environment, where the README's example and the demo run.
"""

import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path


def main(tried):
    folder, maturin = Path(sys.argv[1]).resolve(), str(Path(sys.argv[2]).absolute())
    (sdist,) = folder.glob("*.tar.gz")
    with tempfile.TemporaryDirectory() as place:
        with tarfile.open(sdist) as archive:
            archive.extractall(place, filter="data")
        (tree,) = Path(place).iterdir()
        # What the checkout has compiled of the dependencies is taken from there.
        target = os.environ | {"CARGO_TARGET_DIR": str(folder.parent)}
        build = [maturin, "build", "--profile", "demo", "--no-default-features", "--out", place]
        subprocess.run(build, cwd=tree, env=target, check=True)
        (wheel,) = Path(place).glob("*.whl")
        tried(wheel)
    print(f"{sdist.name} builds by itself, and runs the README's example and the demo")


if __name__ == "__main__":
    # Beside this file, which only a script sees.
    from try_wheel import tried

    main(tried)
