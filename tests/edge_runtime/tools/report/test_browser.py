"""Pages in headless Chromium: they render, nothing complains, nothing is fetched, nothing overflows."""

import shutil

import pytest
from report_files import record

from edge_runtime.tools.report.edge_report import main

pytest.importorskip("matplotlib")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.integration,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: sh tests/support/chromium/install.sh"),
]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    path = folder / "report.html"
    assert main([str(record(folder)), "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def open_page(browser, page_file):
    """Opens the page at a width; returns it with what it complained of and asked for."""

    def open_at(width, **options):
        context = browser.new_context(viewport={"width": width, "height": 800}, **options)
        page, complaints, requests = context.new_page(), [], []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(page_file.as_uri())
        return page, complaints, requests

    return open_at


@pytest.mark.parametrize("width", [320, 390, 1200])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_renders_alone_at_any_width(open_page, page_file, width, scheme):
    page, complaints, requests = open_page(width, color_scheme=scheme)
    assert (complaints, requests) == ([], [page_file.as_uri()])
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    boxes = page.evaluate(
        "[...document.querySelectorAll('figure svg')].map(svg => svg.getBoundingClientRect())"
    )
    assert len(boxes) >= 5
    assert all(box["width"] >= min(width, 600) * 0.8 and box["height"] > 30 for box in boxes)


def test_type_in_drawings_is_readable_on_a_phone(open_page):
    page, _, _ = open_page(390)
    heights = page.evaluate(
        "[...document.querySelectorAll('figure svg text')].map(text => text.getScreenCTM().d * "
        "parseFloat(getComputedStyle(text).fontSize))"
    )
    assert min(abs(height) for height in heights if height) >= 8.5


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_ink_stands_out_from_paper(open_page, scheme):
    """WCAG 2.2's contrast of 4.5 for text, also in drawings."""
    page, _, _ = open_page(1200, color_scheme=scheme)
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    used = page.evaluate(
        "[...new Set([...document.querySelectorAll('h1, figcaption, td, dt, .verdict span, svg text')]"
        ".map(item => item.tagName === 'text' ? getComputedStyle(item).fill : getComputedStyle(item).color))]"
    )
    assert {colour: contrast(colour, paper) for colour in used if contrast(colour, paper) < 4.5} == {}


def contrast(one, other):
    brighter, darker = sorted((luminance(one), luminance(other)), reverse=True)
    return (brighter + 0.05) / (darker + 0.05)


def luminance(colour):
    parts = [int(part) / 255 for part in colour.removeprefix("rgb(").rstrip(")").split(",")]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_paper_gets_pages(open_page):
    page, _, _ = open_page(1200, color_scheme="dark")
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
    assert page.pdf(format="A4").startswith(b"%PDF")
