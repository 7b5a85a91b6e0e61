"""The page in a real Chromium without a screen: wide, and as narrow as a phone."""

import shutil

import pytest
from push_recovery.eval.report.evaluation import write_evaluation_page
from push_recovery.eval.report.page import Command

pytest.importorskip("jinja2", reason="needs the extra report")
sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright to drive a browser")

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync"]  # fmt: skip
PATIENCE = 240e3  # [ms]
PHONE, DESK = 390, 1280  # [px]
LONG = "runs/a-folder-with-a-long-name/another-one-of-the-same-length/policy.safetensors"
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=PATIENCE)
        yield found
        found.close()


@pytest.fixture(scope="module")
def path(evaluation_in, tmp_path_factory):
    """A page with all its parts."""
    letters, folder = "rsfrrfrfsr" * 6, tmp_path_factory.mktemp("page")
    words = {"two-stage": letters, LONG: letters[1:] + "f", "module:An_attribute": letters[::-1]}
    first = evaluation_in(folder, words)
    command = Command(("evaluate",), (("--policies", (LONG, "two-stage")),))
    return write_evaluation_page({"exact": first, "hardware": first}, command, folder)


@pytest.fixture(params=[PHONE, DESK])
def opened(request, browser, path):
    """The page in a new window, what it asked for and what went wrong in it."""
    page = browser.new_context(viewport={"width": request.param, "height": 800}).new_page()
    page.set_default_timeout(PATIENCE)
    asked, wrong = [], []
    page.on("request", lambda one: asked.append(one.url))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda line: wrong.append(line.text) if line.type in {"error", "warning"} else None)
    page.goto(path.as_uri())
    yield page, request.param, path.as_uri(), asked, wrong
    page.close()


def test_it_asks_for_nothing_and_nothing_is_cut(opened):
    page, width, address, asked, wrong = opened
    for details in page.locator("details").all():
        details.evaluate("part => { part.open = true; }")
    beyond = page.evaluate(
        "[...document.querySelectorAll('main *')].filter(e => e.getBoundingClientRect().width > 0"
        " && getComputedStyle(e).position !== 'absolute' && !e.closest('thead')"
        " && e.getBoundingClientRect().right > innerWidth + 0.5).map(e => e.outerHTML.slice(0, 80))"
    )
    assert beyond == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert {url for url in asked if not url.startswith("data:")} == {address}
    assert wrong == []


def test_the_widest_rows_of_the_package_are_not_cut(browser, evaluation, tmp_path):
    """Seven policies with a long name, or with all that they were trained on, as after `make run`."""
    letters = "rsfrrfrfsr" * 6
    names = ("stage-1", "stage-1+momentum", "two-stage", "residual", "residual-hardware", "joint-residual",
             "joint-residual-hardware")  # fmt: skip
    found = evaluation(dict.fromkeys(names, letters))
    for row in found.rows["two-stage"]:  # and there is a column of those that have turned
        row["measures"]["heading_error"] = 0.1
    path = write_evaluation_page({"exact": found, "hardware": found}, Command(("evaluate",), ()), tmp_path)
    page = browser.new_context(viewport={"width": DESK, "height": 800}).new_page()
    page.set_default_timeout(PATIENCE)
    page.goto(path.as_uri())
    assert page.locator("#rates td", has_text="12.0 M actions, quick, hard").count() == 2
    assert page.locator("#rates th", has_text="turned").count() == 2
    assert page.evaluate("document.documentElement.scrollWidth") <= DESK
    page.close()


def test_it_is_short_until_a_part_is_unfolded(opened):
    page, width = opened[:2]
    assert page.evaluate("document.documentElement.scrollHeight") < (8000 if width == DESK else 16000)
    for name in ("pairs", "losses", "manifest"):
        assert not page.locator(f"#{name} p").first.is_visible()
        page.locator(f"nav a[href='#{name}']").click()
        assert page.locator(f"#{name} p").first.is_visible()


def test_a_heading_breaks_in_no_word(opened):
    page, width = opened[:2]
    for details in page.locator("details").all():
        details.evaluate("part => { part.open = true; }")
    if width == DESK:
        cut = page.evaluate(
            "[...document.querySelectorAll('thead th:not(.policy)')]"
            ".filter(e => /^\\w+$/.test(e.textContent))"
            ".filter(e => { const r = document.createRange(); r.selectNodeContents(e);"
            " return r.getClientRects().length > 1; }).map(e => e.textContent)"
        )
        assert cut == []


def test_the_filter_shows_what_is_asked_for(opened):
    page = opened[0]
    page.locator("a[href='#pushes']").click()  # unfolds them
    part = page.locator(".filtered").first
    rows = part.locator("tbody tr:not(.group):visible")
    every = int(part.locator(".count").inner_text().split()[2])
    assert every == 60
    assert 0 < rows.count() < every
    part.get_by_role("button").click()
    assert rows.count() == every
    part.get_by_role("searchbox").fill("trunk single")
    texts = rows.all_inner_texts()
    assert texts
    assert all("trunk" in text and "single" in text for text in texts)
    part.get_by_role("searchbox").fill("")
    part.get_by_role("combobox").select_option("none")
    lost = int(part.locator(".count").inner_text().split()[2])
    scenario_rows = page.locator(".filtered").first.locator("tbody tr.none")
    assert lost == scenario_rows.count() > 0


def test_on_paper_all_is_there_but_the_long_table(opened):
    page = opened[0]
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert page.locator(".onscreen").is_hidden()
    assert page.locator(".onpaper").is_visible()
    assert page.locator("#manifest").is_visible()
    assert page.locator("figure svg").first.is_visible()
