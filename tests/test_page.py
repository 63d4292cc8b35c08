"""The page of a report in headless Chromium. Its numbers follow formulas, so that the tests know what it must show."""

import base64
import hashlib
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import pytest

from eig3.bench.environment import environment
from eig3.bench.matrix import Matrix, in_units, power
from eig3.bench.report.markdown import page as markdown_page
from eig3.bench.report.page import html
from eig3.bench.sweep import Point, WorkPrecisionSet

pytestmark = pytest.mark.system

TARGETS = tuple(10.0**-k for k in range(1, 11))
#: Label, order, and seconds of a step by method.
METHODS = {
    "eig3": ("EIG-3", 2, 1e-8),
    "rk4": ("RK4", 4, 4e-8),
    "eig9": ("EIG-9", 8, 2e-8),
    "rk8 tolerances": ("RK8, tolerances", 8, 9e-8),
    "heyoka": ("heyoka", 12, 8e-7),
}
WIDTHS = {400: "light", 1300: "light", 1600: "dark"}


def points(scale: float) -> list[Point]:
    """Runs with steps 2^-1 to 2^-14. The error in the energy is a tenth of that of the trajectory."""
    found = []
    for mode, speed in (("prepared", 1.0), ("inline", 0.25)):
        for method, (label, order, step) in METHODS.items():
            if method == "heyoka" and mode == "inline":
                continue  # a rival was measured once
            for k in range(1, 15):
                n, error = 2**k * 100, scale * 2.0 ** (-k * order)
                if error > 1e-13:
                    time = n * step * (1.0 if method == "heyoka" else speed)
                    errors = {"trajectory": error, "energy": error / 10}
                    of_mode = "" if method == "heyoka" else mode
                    seconds = [0.9 * time, time, 1.2 * time]
                    found.append(Point(method, label, of_mode, 2.0**-k, n, n + 1, True, errors, seconds))
    found.append(Point("rk4", "RK4", "prepared", 1.5, 60, 240, False, {}, []))
    return found


def result(name: str, title: str, scale: float, uncertainty: float = 1e-13) -> WorkPrecisionSet:
    return WorkPrecisionSet(
        name=name, title=title, description="A mass on a spring. It has one degree of freedom.",
        metric="trajectory", targets=TARGETS, tolerances=True, source="exact solution", uncertainty=uncertainty,
        points=points(scale), skipped=["SciPy LSODA (not installed)"],
        command=f"eig3 bench precision --problem {name}"
    )  # fmt: skip


RESULTS = [result("smooth", "smooth spring, ten periods", 1.0), result("rough", "<i>rough</i> spring", 1e-3, 1e-6)]


def record(results: list[WorkPrecisionSet]) -> SimpleNamespace:
    return SimpleNamespace(
        results=results,
        article=[],
        article_commands=[],
        run=SimpleNamespace(
            environment=environment(),
            command="eig3 bench report --out here",
            settings={"repeats": 3, "longest": 0.02, "modes": None},
        ),
        texts={
            "hard": SimpleNamespace(command="eig3 bench hard", markdown="| case | verdict |\n| - | - |\n| 1 | good |")
        },
        missing=["c"],
        unsolved=[],
        motion=lambda name: None,
    )


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> str:
    """The address of the page."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(html(record(RESULTS)))
    return path.as_uri()


@pytest.fixture
def opened(browser, page) -> Iterator:
    """The page at 1300 pixels, with its first chart drawn. At the end, no script error may have been logged."""
    yield from open_at(browser, page, 1300)


def open_at(browser, page: str, width: int) -> Iterator:
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=WIDTHS[width])
    tab, wrong = context.new_page(), []
    tab.on("console", lambda message: wrong.append(message.text) if message.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("request", lambda request: None if request.url.startswith(("file:", "data:")) else wrong.append(request.url))
    tab.goto(page)
    tab.wait_for_selector("[data-chart=smooth] svg.marks")
    yield tab
    context.close()
    assert not wrong


def marks(tab, chart: str = "smooth") -> list[str]:
    """The labels of the methods of all points in a chart."""
    words = "paths => paths.map(path => path.getAttribute('aria-label').split(':')[0])"
    return tab.eval_on_selector_all(f"[data-chart={chart}] .mark-symbol path", words)


def move_slider(tab, target: float) -> None:
    tab.locator("input[name=accuracy]").fill(str(TARGETS.index(target)))


@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_fits_and_opens_with_the_answer(browser, page, width, tmp_path):
    for tab in open_at(browser, page, width):
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
        table = tab.locator(".matrix:visible")
        assert table.count() == 1
        assert table.bounding_box()["y"] < 900 * 0.75
        cells = table.locator("tbody tr").first.locator("td:visible")
        assert cells.count() == (1 if width == 400 else len(TARGETS))
        for cell in cells.all():  # nothing is cut off
            assert cell.evaluate("cell => cell.scrollWidth <= cell.clientWidth + 1")
        tab.locator("[data-chart=rough]").scroll_into_view_if_needed()
        tab.wait_for_selector("[data-chart=rough] svg.marks")
        assert set(marks(tab, "rough")) == {label for label, *_ in METHODS.values()}
        tab.screenshot(path=tmp_path / f"{width}.png", full_page=True)


def test_cells_hold_the_fastest_its_time_and_its_leads(opened):
    (matrix,) = [Matrix.of(RESULTS[:1], "trajectory", "prepared")]
    cells = opened.locator(".matrix:visible tbody tr").first.locator("td")
    for cell, contest in zip(cells.all(), matrix.rows[0].contests, strict=True):
        words = cell.inner_text()
        for expected in (contest.fastest.label, in_units(contest.fastest.seconds)):
            assert expected in words
        if cell.get_attribute("data-accuracy") == "1e-06":  # chosen at first: its followers have their names
            assert f"\N{MULTIPLICATION SIGN}{contest.next_own.seconds / contest.fastest.seconds:.1f} " in words
            assert contest.rival.label in words


def test_nothing_is_claimed_below_the_uncertainty_of_the_truth(opened):
    cells = opened.locator(".matrix:visible tbody tr").nth(1).locator("td")
    words = [cell.inner_text() for cell in cells.all()]
    assert [word == "unknown" for word in words] == [target < 3e-6 for target in TARGETS]


def test_the_slider_moves_the_answer_the_columns_and_the_line(opened):
    def rule() -> float:
        return opened.locator("[data-chart=smooth] line[stroke-dasharray='2,4']").bounding_box()["y"]

    before, high = opened.locator(".sentence:visible").inner_text(), rule()
    assert power(1e-6) in before
    move_slider(opened, 1e-9)
    opened.wait_for_function("document.querySelector('output').textContent === '1e-9'")
    assert power(1e-9) in opened.locator(".sentence:visible").inner_text()
    assert rule() > high + 20  # pixels: three decades lower
    chosen = opened.locator(".here-column:visible").evaluate_all("cells => cells.map(cell => cell.dataset.accuracy)")
    assert set(chosen) == {"1e-09"}
    assert "accuracy=1e-9" in opened.url


def test_the_switches_change_matrix_tables_and_charts(opened):
    def time_of_first_cell() -> str:
        return opened.locator(".matrix:visible tbody td .how-long").first.inner_text()

    pointer = time_of_first_cell()
    opened.get_by_text("inline", exact=True).click()
    assert time_of_first_cell() != pointer
    expected = Matrix.of(RESULTS, "trajectory", "inline").rows[0].contests[0].fastest
    assert time_of_first_cell() == in_units(expected.seconds)
    opened.get_by_text("energy", exact=True).click()
    opened.wait_for_function(
        "document.querySelector('[data-chart=smooth] svg.marks').textContent.includes('energy error')"
    )
    assert "in the energy" in opened.locator(".sentence:visible").inner_text()
    assert "in the energy" in opened.locator("#problem-smooth h3:visible").inner_text()
    assert "metric=energy&mode=inline" in opened.url


def test_an_address_brings_back_what_was_chosen(browser, page):
    for tab in open_at(browser, f"{page}?metric=energy&mode=inline&accuracy=1e-8", 1300):
        assert tab.locator("output").inner_text() == "1e-8"
        sentence = tab.locator(".sentence:visible").inner_text()
        assert "1e-8 in the energy, counting the kernel, which has the right-hand side compiled in" in sentence


def test_a_point_tells_its_run(opened):
    point = opened.locator("[data-chart=smooth] path[aria-label^='EIG-9:']").nth(2)
    point.hover(force=True)
    opened.wait_for_selector("#vg-tooltip-element.visible")
    lines = "lines => lines.map(line => [...line.cells].map(cell => cell.textContent.replace(/:$/, '')))"
    rows = dict(opened.eval_on_selector_all("#vg-tooltip-element tr", lines))
    run = next(p for p in RESULTS[0].points if p.method == "eig9" and f"{p.n_steps:,}" == rows["steps"])
    assert rows["method"] == "EIG-9"
    assert rows["step (s) or tolerance"] == f"{run.setting:.3g}"
    assert rows["evaluations"] == f"{run.evaluations:,}"
    assert float(rows["error"].replace("\N{MINUS SIGN}", "-")) == pytest.approx(run.errors["trajectory"], rel=0.01)
    assert rows["time: median (range)"].startswith(re.sub(r"\.?0+ ", " ", in_units(run.time)))


def test_the_legend_hides_and_shows_a_method(opened):
    key = opened.locator("[data-chart=smooth] .legend button", has_text="EIG-9")
    assert "EIG-9" in marks(opened)
    key.click()
    opened.wait_for_function("!document.querySelector(\"[data-chart=smooth] path[aria-label^='EIG-9:']\")")
    assert key.get_attribute("aria-pressed") == "false"
    assert "RK4" in marks(opened)
    opened.keyboard.press("Enter")  # the key is still the one that has the focus
    opened.wait_for_selector("[data-chart=smooth] path[aria-label^='EIG-9:']")


def test_each_method_has_the_same_marker_everywhere(opened):
    """Without colour, the outline and the sign tell the method; both must be those of the legend."""
    badges = "badges => badges.map(b => [b.textContent, b.querySelector('path').getAttribute('d')].join())"
    in_key, in_legend = (
        opened.eval_on_selector_all(f"{place} .badge", badges) for place in (".keys", "[data-chart=smooth] .legend")
    )
    assert in_key == in_legend
    texts = "texts => [...new Set(texts.map(text => text.textContent))]"
    signs = opened.eval_on_selector_all("[data-chart=smooth] .mark-text[role=graphics-object] text", texts)
    assert set(signs) == {badge.partition(",")[0] for badge in in_legend}
    assert len(set(in_legend)) == len(METHODS)


def test_evaluations_in_place_of_time_and_zoom(opened):
    def labels() -> str:
        return " ".join(opened.locator("[data-chart=smooth] .role-axis-label text").all_text_contents())

    assert "\N{MICRO SIGN}s" in labels()
    opened.locator("#problem-smooth").get_by_text("against evaluations").click()
    opened.wait_for_function(
        "document.querySelector('[data-chart=smooth] svg.marks').textContent.includes('evaluations of')"
    )
    assert "\N{MICRO SIGN}s" not in labels()
    before, box = labels(), opened.locator("[data-chart=smooth] svg.marks").bounding_box()
    opened.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.keyboard.down("Control")
    opened.mouse.wheel(0, -600)
    opened.keyboard.up("Control")
    opened.wait_for_timeout(300)
    assert labels() != before


def test_print_has_every_chart(opened):
    assert len(opened.pdf()) > 10_000
    assert opened.locator("[data-chart] svg.marks").count() == len(RESULTS)


def test_without_scripts_every_table_is_there(browser, page):
    context = browser.new_context(java_script_enabled=False)
    tab = context.new_page()
    tab.goto(page)
    assert tab.locator(".matrix:visible").count() == 4
    context.close()


def test_titles_are_text_and_the_file_is_small():
    text = html(record(RESULTS))
    assert "<i>rough</i>" not in text
    assert "&lt;i&gt;rough&lt;/i&gt; spring" in text
    assert "Not measured yet: c" in text
    assert len(text.encode()) < 2e6  # of which the chart library is 0.9 MB


SCRIPT = "<script>window.foreign = 1</script>"
HOSTILE = f"</script>{SCRIPT}<!--<img src=x onerror='window.foreign = 1'>\"'&\u2028"
HOSTILE_MARKDOWN = f"""
{SCRIPT}

Words <img src=x onerror="window.foreign = 1"> and <svg onload="window.foreign = 1"></svg>, `{SCRIPT}`.

<iframe srcdoc="{SCRIPT}"></iframe>

| a {SCRIPT} | b |
| - | - |
| [x](javascript:window.foreign=1) | [y](java&#115;cript:window.foreign=1) |

[z][z] <javascript:window.foreign=1> [t](https://a.example "t\" onmouseover=\"window.foreign=1") <https://b.example>
![far](https://c.example/p.png) ![near](javascript:window.foreign=1) [d](data:text/html,{SCRIPT}) [e](<JAVASCRIPT:x>)

[z]: javascript:window.foreign=1

```{{#data .x onclick=window.foreign=1}}
{{"charts": {{}}}}
```
"""


def hostile_record() -> SimpleNamespace:
    """A record in which everything that a file can hold tries to run a script."""
    hostile = replace(
        RESULTS[0],
        title=HOSTILE,
        description=HOSTILE,
        source=HOSTILE,
        skipped=[HOSTILE],
        command=HOSTILE,
        points=[replace(point, label=f"{point.label}{HOSTILE}") for point in RESULTS[0].points]
        + [replace(point, method=HOSTILE, label=HOSTILE) for point in RESULTS[0].of("rk4")],
    )
    found = record([hostile, replace(RESULTS[1], name=HOSTILE)])
    found.run.environment = {**found.run.environment, "cpu": HOSTILE}
    found.run.command, found.missing, found.unsolved = HOSTILE, [HOSTILE], [HOSTILE]
    texts = {name: SimpleNamespace(command=HOSTILE, markdown=HOSTILE_MARKDOWN) for name in ("c", "stability", "hard")}
    found.texts = texts
    return found


COMPARISON = SimpleNamespace(markdown=HOSTILE_MARKDOWN, everything=HOSTILE_MARKDOWN)


def hostile_page() -> str:
    return html(hostile_record(), COMPARISON)


class Elements(HTMLParser):
    """The tags of a page with their attributes, and the texts of its scripts."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        if self.tags and self.tags[-1][0] == "script" and self.cdata_elem == "script":
            self.scripts.append(data)

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def test_nothing_that_comes_from_files_is_markup():
    parsed = Elements(hostile_page())
    assert parsed.of("script") == [{}, {"type": "application/json", "id": "data"}, {}]
    assert {tag for tag, _ in parsed.tags}.isdisjoint({"iframe", "object", "embed", "base", "img", "frame"})
    attributes = [pair for _, each in parsed.tags for pair in each.items()]
    assert not [name for name, _ in attributes if name.startswith("on") or name in ("srcdoc", "action", "formaction")]
    addresses = {str(value) for name, value in attributes if name in ("href", "src", "xlink:href")}
    elsewhere = {address for address in addresses if not address.startswith("#")}
    assert elsewhere == {"https://a.example", "https://b.example"}
    assert len(parsed.of("meta")) == 4


def test_the_markdown_has_no_tags():
    assert re.findall("<[a-zA-Z/!?].*", markdown_page(hostile_record(), COMPARISON)) == []


def test_only_the_pages_own_scripts_are_allowed_to_run():
    parsed = Elements(html(record(RESULTS)))
    (policy,) = [meta["content"] for meta in parsed.of("meta") if meta.get("http-equiv") == "Content-Security-Policy"]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    charts, _, own = parsed.scripts
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in (charts, own)]
    assert rules["script-src"].split() == [f"'sha256-{one}'" for one in hashes]
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["img-src"] == "data:"
    names = [name for name, _ in parsed.tags]
    assert names.index("meta") < names.index("style") < names.index("script")


def test_no_foreign_script_runs(browser, tmp_path):
    """Not those of hostile files; and the policy stops one that came into the page in another way."""
    foreign = f"{SCRIPT}<img src=x onerror='window.foreign = 1'><a id=try href='javascript:window.foreign = 1'>x</a>"
    pages = {"hostile": hostile_page(), "smuggled": html(record(RESULTS)).replace("<main>", f"<main>{foreign}")}
    for name, text in pages.items():
        (tmp_path / f"{name}.html").write_text(text, encoding="utf-8")
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tab.goto((tmp_path / f"{name}.html").as_uri())
        tab.locator("[data-chart=smooth]").scroll_into_view_if_needed()
        tab.wait_for_selector("[data-chart=smooth] svg.marks")
        tab.hover("[data-chart=smooth] path[aria-label^='EIG-9']", force=True)
        tab.wait_for_selector("#vg-tooltip-element.visible")
        if name == "smuggled":
            tab.locator("#try").click()
        assert tab.evaluate("window.foreign") is None
        tab.close()
