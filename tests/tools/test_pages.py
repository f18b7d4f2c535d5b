"""The pages about all operations are what the schemas, the registry and the lists of differences say."""

import re
from collections import Counter

import pytest

from prefect_robomaker.schemas.operations.registry import OPERATION_GROUPS, OPERATIONS
from tools.reference.behaviours import BEHAVIOURS
from tools.reference.differences import DIFFERENCES
from tools.reference.pages import DOCS, pages, with_tables
from tools.reference.tables import Tables

OPERATIONS_PAGE = DOCS / "operations.md"
HINT = "run `python -m tools.reference` and commit what it writes"


def section(operation: str) -> str:
    """What the page says of an operation."""
    return re.split(r"^##+ ", OPERATIONS_PAGE.read_text().split(f"\n### {operation}\n", 1)[1], flags=re.MULTILINE)[0]


def anchors(text: str) -> list[str]:
    """The anchors that GitHub gives a page's headings."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL), re.MULTILINE)
    return [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]


def test_what_is_committed_is_current() -> None:
    assert [path.name for path, text in pages().items() if path.read_text() != text] == [], HINT


def test_every_operation_has_a_group_and_a_section() -> None:
    grouped = [each.name for group in OPERATION_GROUPS.values() for each in group]

    assert sorted(grouped) == sorted(OPERATIONS)
    for name in grouped:
        assert f"robomaker call {name} --input" in section(name)


@pytest.mark.parametrize("name", ["operations.md", "coming-from-robomaker.md", "verdicts.md"])
def test_links_lead_to_headings(name: str) -> None:
    text = (DOCS / name).read_text()
    headings = anchors(text)

    assert [each for each, count in Counter(headings).items() if count > 1] == []
    for page, anchor in re.findall(r"\]\(([\w.-]*)#([\w-]+)\)", text):
        assert anchor in (anchors((DOCS / page).read_text()) if page else headings), f"{page}#{anchor}"


def test_a_section_says_where_it_is_called_what_it_takes_and_what_it_refuses() -> None:
    page = section("CreateSimulationJob")

    assert "`POST /createSimulationJob`" in page
    assert "`prefect_robomaker.flows.operations:CreateSimulationJob`" in page
    assert "`prefect_robomaker.flows.operations:PerformSimulationJob`" in page
    assert "| `maxJobDurationInSeconds`, **required** | whole number, 1 to 1209600 |" in page
    assert "`IdempotentParameterMismatchException`" in page
    assert "**`seed`.** Extension" in page
    assert "**`maxJobDurationInSeconds` from 1.** No number below 1" in page
    assert "**`maxJobDurationInSeconds` to 1209600.** The service's documentation gives the bound" in page


def test_members_outside_the_body_and_bounds_that_differ_by_operation_are_told() -> None:
    assert "| `tagKeys`, **required**, in the query, once for each entry |" in section("UntagResource")
    assert "`DELETE /tags/{resourceArn}`" in section("UntagResource")
    assert "| `maxResults` | whole number, 1 to 1000 |" in section("ListSimulationJobs")
    assert "| `maxResults` | whole number, 1 to 200 |" in section("ListFleets")
    assert "| `maxResults` | whole number, 1 to 100 |" in section("ListWorlds")


def test_pipes_in_patterns_do_not_end_a_cell() -> None:
    row = next(line for line in section("CreateSimulationJob").splitlines() if line.startswith("| `iamRole`"))
    assert row.count(" | ") == 2
    version = next(
        line for line in section("DescribeRobotApplication").splitlines() if line.startswith("| `applicationVersion`")
    )
    assert r"`(\$LATEST)\|[0-9]*`" in version


def test_every_shape_that_is_linked_to_is_there() -> None:
    text = OPERATIONS_PAGE.read_text()
    roots = iter(shape.__name__ for each in OPERATIONS.values() for shape in (each.request, each.response))

    for name in Tables().named(roots):
        assert f"\n### {name}\n" in text


def test_every_difference_of_the_interface_is_listed_with_its_reason() -> None:
    text = OPERATIONS_PAGE.read_text()

    for difference in DIFFERENCES:
        assert f"| `{difference.where}` |" in text
        assert difference.reason in text


def test_what_is_listed_of_operations_names_operations_and_is_told() -> None:
    for group, behaviours in BEHAVIOURS.items():
        topics = [each.topic for each in behaviours]
        assert len(topics) == len(set(topics))
        for behaviour in behaviours:
            assert bool(behaviour.operations) == (group != "All operations"), behaviour
            assert set(behaviour.operations) <= set(OPERATIONS), behaviour
            for operation in behaviour.operations:
                assert behaviour.here in section(operation)


def test_what_people_wrote_around_a_table_stays() -> None:
    page = with_tables("before\n<!-- made: differences -->\nold\n<!-- end -->\nafter\n")

    assert page.startswith("before\n<!-- made: differences -->\n\n| ")
    assert page.endswith("\n\n<!-- end -->\nafter\n")
    assert "\nold\n" not in page
    assert with_tables(page) == page


def test_a_mark_that_names_no_table_is_an_error() -> None:
    with pytest.raises(ValueError, match="'nothing' is no table; there are calls, "):
        with_tables("<!-- made: nothing -->\n<!-- end -->")
