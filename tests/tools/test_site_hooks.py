"""Links of the repository's pages lead to the same files on the site."""

from types import SimpleNamespace

import pytest

from tools.site_hooks import on_config, on_page_markdown


def on_site(markdown: str, source: str) -> str:
    """A page's Markdown as the site gets it.

    Args:
        markdown: As it is in the repository.
        source: Path of the page in the site.
    """
    return on_page_markdown(markdown, SimpleNamespace(file=SimpleNamespace(src_uri=source)))


@pytest.mark.parametrize(
    ("source", "written", "expected"),
    [
        ("trials.md", "[a](verdicts.md#kinds)", "[a](verdicts.md#kinds)"),
        ("fleet/robomaker-agent.md", "[a](../trials.md)", "[a](../trials.md)"),
        ("index.md", "[a](../README.md#try-it)", "[a](repository/README.md#try-it)"),
        ("fleet/robomaker-agent.md", "[a](../../SECURITY.md)", "[a](../repository/SECURITY.md)"),
        ("repository/README.md", "[a](docs/trials.md)", "[a](../trials.md)"),
        ("repository/README.md", "![a picture](docs/images/world.png)", "![a picture](../images/world.png)"),
        ("repository/README.md", "[a](CONTRIBUTING.md)", "[a](CONTRIBUTING.md)"),
        ("architecture.md", "[`tasks`](../tasks) and more", "`tasks` and more"),
        ("index.md", "[a](https://www.prefect.io), [b](#here)", "[a](https://www.prefect.io), [b](#here)"),
        ("index.md", "```\n[a](../README.md)\n```", "```\n[a](../README.md)\n```"),
    ],
)
def test_links_lead_to_the_files_of_the_site(source: str, written: str, expected: str) -> None:
    assert on_site(written, source) == expected


def test_every_page_of_the_map_is_in_the_navigation_once() -> None:
    _, *sections = on_config({})["nav"]
    pages = [page for section in sections for entries in section.values() for page in entries]
    targets = [page if isinstance(page, str) else next(iter(page.values())) for page in pages]

    assert {"trials.md", "fleet/robomaker-agent.md", "repository/README.md"} < set(targets)
    assert len(set(targets)) == len(targets)
