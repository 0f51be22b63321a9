"""The explorer's page, built once, and a browser."""

import pytest

from explorer_page import absent, chromium, load_build


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    build = load_build()
    if not build.target_is_there():
        absent(build.MISSING)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        absent("the explorer's tests need playwright: pip install playwright")
    program = chromium()
    if program is None:
        absent("the explorer's tests need Chromium: apt-get install chromium")
    # The second is where the package looks for it.
    page = build.build(tmp_path_factory.mktemp("explorer") / "explorer.html", build.PAGES[1])
    with sync_playwright() as driver:
        # A container has no user namespaces, and the page is ours.
        started = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield started, page.as_uri()
        started.close()
