"""The page by keyboard, for a screen reader and in the dark: names, landmarks, tables that scroll, contrast."""

import pytest
from tests.support.contrast import too_faint
from tests.support.sample_results import table2
from tests.support.serving import upload

WAIT_MS = 120_000
ROWS = "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))
#: What can be pressed or filled in and has no name; tags and classes, for the message.
UNNAMED = """() => [...document.querySelectorAll(
  'button, a[href], [role=button], [role=checkbox], input, select')].filter(e => {
  if (getComputedStyle(e).display === 'none') return false;
  const by = (e.getAttribute('aria-labelledby') || '').split(' ').map(id => document.getElementById(id)?.innerText);
  const words = [...e.childNodes].map(n => n.textContent).join('').trim();
  const icon = e.querySelector('.q-icon')?.textContent.trim();
  const labels = [...(e.labels || [])].map(label => label.innerText);
  return !(e.getAttribute('aria-label') || by.concat(labels).join('').trim() || (words && words !== icon));
}).map(e => e.outerHTML.slice(0, 160))"""
#: What scrolls and neither takes the focus nor holds what does.
UNREACHABLE = """() => [...document.querySelectorAll('#main *')].filter(e => {
  const style = getComputedStyle(e);
  const scrolls = (['auto', 'scroll'].includes(style.overflowX) && e.scrollWidth > e.clientWidth + 1)
    || (['auto', 'scroll'].includes(style.overflowY) && e.scrollHeight > e.clientHeight + 1);
  return scrolls && e.tabIndex < 0 && !e.querySelector('[tabindex="0"], button, input');
}).map(e => e.outerHTML.slice(0, 160))"""


@pytest.fixture
def filled(visit, tmp_path):
    """The page with data and a result."""

    def fill(width):
        (tmp_path / "a.csv").write_text(ROWS)
        page = visit(width)
        upload(page, tmp_path / "a.csv", table2().save(tmp_path / "earlier.json"))
        page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
        page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
        return page

    return fill


@pytest.mark.parametrize("width", [1280, 390])
def test_everything_has_a_name_and_can_be_reached(filled, violations, width):
    page = filled(width)
    assert page.evaluate(UNNAMED) == []
    assert violations(page) == []
    assert page.evaluate("document.querySelectorAll('main, [role=main]').length") == 1
    assert page.get_by_label("Files", exact=True).count() == 1
    assert page.get_by_role("button", name="Choose files").is_visible()
    with page.expect_file_chooser():
        page.get_by_role("button", name="Choose files").press("Enter")
    assert page.evaluate(UNREACHABLE) == []
    table = page.locator("#result .scroll").first
    table.focus()
    assert table.evaluate("e => e === document.activeElement")
    if width == 390:
        page.keyboard.press("ArrowRight")
        page.wait_for_function("document.querySelector('#result .scroll').scrollLeft > 0")


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_can_be_read_in_light_and_dark(filled, picture, violations, width, scheme):
    page = filled(width)
    page.emulate_media(color_scheme=scheme)
    dark = "matches" if scheme == "dark" else "!matches"
    page.wait_for_function(f"(matches => {dark})(document.body.classList.contains('body--dark'))")
    page.wait_for_timeout(600)  # colours change slowly
    picture(page, f"{scheme}-{width}")
    assert too_faint(page) == []
    assert violations(page) == []
    ground = page.locator("#data").evaluate("e => getComputedStyle(e).backgroundColor")
    assert (sum(map(int, ground[4:-1].split(","))) < 200) == (scheme == "dark")
