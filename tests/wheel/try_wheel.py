"""Try a wheel in an empty environment: python tests/wheel/try_wheel.py FOLDER

Installs the wheel of the folder with nothing but what it asks for, runs the README's
first example there and the demo, and prints the sizes.
"""

import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parents[2]


def page_is_built():
    return (ROOT / "python/gramian/explorer/page.html").is_file()


def tried(wheel):
    """Install a wheel alone, run the README's example and the demo; say whether it has the page."""
    block = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[1]
    claims = [a or b for a, b in re.findall(r"print\(.*?\)\s*# (.*)|\n# (.*)", block)]
    with tempfile.TemporaryDirectory() as place:
        venv.create(Path(place) / "env", with_pip=True)
        python = str(Path(place) / "env" / "bin" / "python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", str(wheel)], check=True)
        # From elsewhere, so that the checkout is not what is imported.
        run = {"cwd": place, "text": True, "capture_output": True}
        said = subprocess.run([python, "-c", block], check=True, **run).stdout.splitlines()
        if said != claims:
            sys.exit(f"the README's example printed {said}, not {claims}")
        demo = subprocess.run(
            [python, "-m", "gramian", "demo", "--out", "demo"], check=True, **run
        ).stdout
        for verdict in ("OBSERVABLE", "HOPELESS", "UNOBSERVABLE"):
            if verdict not in demo:
                sys.exit(f"the demo does not say {verdict}:\n{demo}")
        explore = [python, "-m", "gramian", "explore", "--out", "page.html"]
        said = subprocess.run(explore, check=False, **run)
        return said.returncode == 0 and (Path(place) / "page.html").stat().st_size > 100_000


def main():
    folder = Path(sys.argv[1]).resolve()
    (wheel,) = folder.glob("*.whl")
    if "abi3" not in wheel.name:
        sys.exit(f"{wheel.name} is not an abi3 wheel")
    carried = tried(wheel)
    print("the wheel", "has" if carried else "is without", "the explorer's page")
    if page_is_built() and not carried:
        sys.exit("the explorer's page was built, and the wheel does not have it")
    for path in sorted(folder.iterdir()):
        print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
    print("the wheel runs the README's example and the demo in an empty environment")


if __name__ == "__main__":
    main()
