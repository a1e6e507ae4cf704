"""The page by keyboard, for a screen reader and in the dark: names, landmarks, tables that scroll, contrast."""

from tests.support.contrast import too_faint
from tests.support.sample_results import table2
from tests.support.serving import WAIT_MS, upload

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


def test_everything_has_a_name_can_be_reached_and_can_be_read_in_light_and_dark(visit, looks, violations, tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    page = visit()
    upload(page, tmp_path / "a.csv", table2().save(tmp_path / "earlier.json"))
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
    for number, scheme in enumerate(looks(page, "filled")):
        dark = "matches" if scheme == "dark" else "!matches"
        page.wait_for_function(f"(matches => {dark})(document.body.classList.contains('body--dark'))")
        assert page.evaluate(UNNAMED) == []
        assert page.evaluate(UNREACHABLE) == []
        if number in (0, 3):  # axe takes seconds: both widths and both schemes, each once
            assert violations(page) == []
        assert too_faint(page) == []
        ground = page.locator("#data").evaluate("e => getComputedStyle(e).backgroundColor")
        assert (sum(map(int, ground[4:-1].split(","))) < 200) == (scheme == "dark")
    assert page.evaluate("document.querySelectorAll('main, [role=main]').length") == 1
    assert page.get_by_label("Files", exact=True).count() == 1
    assert page.get_by_role("button", name="Choose files").is_visible()
    with page.expect_file_chooser():
        page.get_by_role("button", name="Choose files").press("Enter")
    table = page.locator("#result .scroll").first
    table.focus()
    assert table.evaluate("e => e === document.activeElement")
    page.keyboard.press("ArrowRight")  # at the last, 390 px
    page.wait_for_function("document.querySelector('#result .scroll').scrollLeft > 0")
