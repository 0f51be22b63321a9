"""Check a built site: python docs/_site/check.py site

Every link within the site leads to a file and a place in it, nothing is loaded from a
network, every public name has its entry, and the search index knows them.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

sys.path.insert(0, str(Path(__file__).parents[1]))
from _site import reference

#: Attributes by which a page loads something.
LOADS = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src"), ("source", "src")}


class Page(HTMLParser):
    """Collect what a page points to, what it loads, and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def has(self, fragment: str) -> bool:
        """Say whether a link may lead to this place."""
        return unquote(fragment) in self.anchors

    def handle_starttag(self, tag, attributes):
        """Take what an element says."""
        for key, value in attributes:
            if key == "id" and value:
                self.anchors.add(value)
            elif (tag, key) in LOADS and value:
                self.loads.append(value)
            elif tag == "a" and key == "href" and value:
                self.links.append(value)


def problems(site: Path) -> list[str]:
    """Give everything that is wrong, in words."""
    files = [path for path in site.rglob("*.html") if "rust" not in path.relative_to(site).parts]
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in files}
    found = []
    for path, page in pages.items():
        where = path.relative_to(site.resolve())
        for link in page.links + page.loads:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loads and parts.scheme != "data":
                    found.append(f"{where} loads {link} from a network")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                found.append(f"{where}: dead link {link}")
            elif parts.fragment and target in pages and not pages[target].has(parts.fragment):
                found.append(f"{where}: no place {link}")
    for name, module in reference.modules().items():
        page = pages[(site / "reference" / "generated" / f"{name}.html").resolve()]
        found += [
            f"{name}.{each} has no entry in the reference"
            for each in reference.names(module)
            if each != "__version__" and not page.has(f"{name}.{each}")
        ]
    return found


def main() -> None:
    """Print what is wrong and fail, or say how large the site is."""
    site = Path(sys.argv[1])
    found = problems(site)
    print(*found, sep="\n")
    if found:
        sys.exit(f"{len(found)} errors in the site")
    files = [path for path in site.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files) / 1e6
    print(f"the site is in {site}: {len(files)} files, {size:.0f} MB; open {site}/index.html")


if __name__ == "__main__":
    main()
