"""Pages of the console in a browser: whether they keep the rules of accessible pages."""

from helpers.browser import Page


def check_rules(page: Page, axe: str) -> None:
    """Checks a page by axe-core's rules, in the colours of day and night.

    Args:
        page: What the browser shows.
        axe: The script of axe-core.
    """
    page.evaluate(f"{axe}\n;null")
    for scheme in ("light", "dark"):
        page.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        script = "axe.run().then((found) => found.violations.map((each) => `${each.id}: ${each.nodes[0].html}`))"
        assert page.evaluate(script) == [], (page.address, scheme)
