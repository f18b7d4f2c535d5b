"""Hooks of mkdocs: the site has the pages of `docs`, and whatever of the repository they link to.

On the repository's own pages a link such as `../README.md` works; here the file becomes a part of the site. A link
to a folder, which no site shows, becomes its text.
"""

import posixpath
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
_INDEX = DOCS / "index.md"
_COPIES = "repository"
"""Folder of the site for files that are outside `docs`."""
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def on_config(config: Any) -> Any:
    """Makes the navigation from the table of `docs/index.md`, and the folder of decisions."""
    decisions = [f"decisions/{path.name}" for path in sorted((DOCS / "decisions").glob("*.md"))]
    sections = _sections(_INDEX.read_text())
    config["nav"] = [{"Documentation": "index.md"}, *sections, {"Decisions": decisions}]
    return config


def _sections(index: str) -> Iterator[Mapping[str, Any]]:
    heading, pages = "", list[Mapping[str, str]]()
    seen: set[str] = set()
    for line in index.splitlines():
        if found := re.match(r"\| \*\*(.+?)\*\* \|", line):
            if pages:
                yield {heading: pages}
            heading, pages = found[1].capitalize(), []
        elif (found := re.search(r"\[([^\]]+)\]\(([^)#]+\.md)(?:#[^)]*)?\) \|$", line)) and found[2] not in seen:
            seen.add(found[2])
            pages.append({found[1]: _on_site(_resolved("docs/index.md", found[2]))})
    yield {heading: pages}


def on_files(files: Any, config: Any) -> Any:
    """Adds the files outside `docs` that pages link to, and those that these link to."""
    from mkdocs.structure.files import File  # pyright: ignore[reportMissingImports] - of the group `site`

    waiting = [f"docs/{file.src_uri}" for file in files if file.src_uri.endswith(".md")]
    seen = set(waiting)
    while waiting:
        page = waiting.pop()
        for path in _linked(page):
            if path not in seen and not path.startswith("docs/") and (ROOT / path).is_file():
                seen.add(path)
                files.append(File.generated(config, _on_site(path), abs_src_path=str(ROOT / path)))
                if path.endswith(".md"):
                    waiting.append(path)
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lets a page's links lead to the site's files, and Markdown be read within `<details>`."""
    source = page.file.src_uri
    origin = source.removeprefix(f"{_COPIES}/") if source.startswith(f"{_COPIES}/") else f"docs/{source}"
    here = posixpath.dirname(source)
    parts, end = [], 0
    for block in _CODE.finditer(markdown):
        parts += [_with_links(markdown[end : block.start()], origin, here), block[0]]
        end = block.end()
    parts.append(_with_links(markdown[end:], origin, here))
    return "".join(parts).replace("<details>", '<details markdown="1">')


def _with_links(text: str, origin: str, here: str) -> str:
    def changed(link: re.Match[str]) -> str:
        mark, words, target = link.groups()
        if re.match(r"[a-z]+:|#", target):
            return link[0]
        path, number, anchor = target.partition("#")
        resolved = _resolved(origin, path)
        if (ROOT / resolved).is_dir():
            return words
        return f"{mark}[{words}]({posixpath.relpath(_on_site(resolved), here or '.')}{number}{anchor})"

    return _LINK.sub(changed, text)


def _linked(page: str) -> Iterator[str]:
    for _, _, target in _LINK.findall(_CODE.sub("", (ROOT / page).read_text())):
        if not re.match(r"[a-z]+:|#", target):
            yield _resolved(page, target.partition("#")[0])


def _resolved(page: str, target: str) -> str:
    """The path of a link's target, from the root of the repository on."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), target))


def _on_site(path: str) -> str:
    """The path of a file of the repository in the site."""
    return path.removeprefix("docs/") if path.startswith("docs/") else f"{_COPIES}/{path}"
