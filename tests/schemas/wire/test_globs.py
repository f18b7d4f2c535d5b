"""Globs of upload configurations, against a translation into regular expressions."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.globs import Glob, GlobError


@pytest.mark.parametrize(
    ("glob", "path", "matches"),
    [
        ("/var/log/*.log", "/var/log/a.log", True),
        ("/var/log/*.log", "/var/log/.log", True),
        ("/var/log/*.log", "/var/log/deep/a.log", False),
        ("/var/log/**", "/var/log/deep/er/a.log", True),
        ("/var/log/**", "/var/log/", True),
        ("/var/log/**", "/var/logs", False),
        ("/var/log/**.bag", "/var/log/a/b.bag", True),
        ("/var/**/b", "/var/a/c/b", True),
        ("/var/**/b", "/var/b", False),
        ("/a?c", "/abc", True),
        ("/a?c", "/a/c", False),
        ("/[a-c]", "/b", True),
        ("/[a-c]", "/d", False),
        ("/[!a-c]", "/d", True),
        ("/[!abc]", "/b", False),
        ("/[a-c9]", "/9", True),
        ("/[a-]", "/-", True),
        ("/{one,two*}", "/twofold", True),
        ("/{one,two*}", "/onefold", False),
        ("/{a,{b,c}d}", "/cd", True),
        ("/{,x}y", "/y", True),
        (r"/\*", "/*", True),
        (r"/\*", "/a", False),
        (r"/[\]]", "/]", True),
        ("/a,b", "/a,b", True),
        ("/é*", "/école", True),
    ],
)
def test_globs_mean_what_the_guide_of_the_library_says(glob: str, path: str, matches: bool) -> None:
    assert Glob(glob).matches(path) is matches


@pytest.mark.parametrize(
    ("glob", "words"),
    [
        ("/[a", r"has a '\['"),
        ("/{a", r"has a '\{'"),
        ("/a}", r"has a '\}' without"),
        ("/a\\", "ends with a backslash"),
        ("/[]", "without characters"),
        ("/[z-a]", "wrong way round"),
        ("{" * 50 + "}" * 50, "more than 20"),
    ],
)
def test_what_is_no_glob_is_refused_with_a_reason(glob: str, words: str) -> None:
    with pytest.raises(GlobError, match=words):
        Glob(glob)


@pytest.mark.parametrize(
    ("glob", "folder"),
    [
        ("/home/robomaker/**", "/home/robomaker"),
        ("/home/robomaker/maps/a*.pgm", "/home/robomaker/maps"),
        ("/home/robomaker/{a,b}/c", "/home/robomaker"),
        ("/var/log/system.log", "/var/log"),
        (r"/var/log/a\*/b", "/var/log"),
    ],
)
def test_the_fixed_folder_is_what_all_matches_share(glob: str, folder: str) -> None:
    assert Glob(glob).fixed_folder == folder


def test_a_glob_knows_the_folders_it_has_nothing_in() -> None:
    glob = Glob("/var/log/*/{a,b}*.log")
    assert glob.may_match_below("/var/log")
    assert glob.may_match_below("/var/log/x")
    assert not glob.may_match_below("/var/log/x/y")
    assert not glob.may_match_below("/home")


PIECES = st.one_of(
    st.sampled_from(["*", "**", "?", "/", "[ab]", "[!a]", "[a-c]", r"\*"]),
    st.sampled_from("abc."),
    st.lists(st.text("abc*?/", max_size=3), min_size=1, max_size=3).map(lambda arms: "{" + ",".join(arms) + "}"),
)


def as_expression(glob: str) -> str:
    """The same as a regular expression, in one pass over the text."""
    tokens = re.findall(r"\*\*|\*|\?|\[!?[^\]]*\]|\\.|.", glob)
    fixed = {"**": "(?:.*)", "*": "(?:[^/]*)", "?": "[^/]", "{": "(?:", ",": "|", "}": ")"}
    return "".join(
        fixed.get(token) or (token.replace("[!", "[^") if len(token) > 2 else re.escape(token[-1])) for token in tokens
    )


@given(glob=st.lists(PIECES, max_size=8).map("".join), path=st.text("abc./*", max_size=10))
def test_any_glob_matches_what_its_expression_matches(glob: str, path: str) -> None:
    # Stars that meet mean `**`; three of them could be read in two ways that match the same.
    assert Glob(glob).matches(path) is bool(re.fullmatch(as_expression(glob), path, re.DOTALL))


def test_a_twisted_glob_takes_no_longer_than_its_length_times_the_paths() -> None:
    """One that tries every way to read it would not come back while the test run lasts."""
    glob = Glob("/" + "**a" * 300)

    assert not glob.matches("/" + "a" * 299 + "b" * 100)


def test_names_that_are_not_in_utf_8_match() -> None:
    """Python shows bytes that it cannot decode as lone surrogates."""
    path = b"/var/log/\xff.log".decode(errors="surrogateescape")
    assert all(Glob(glob).matches(path) for glob in ("/var/log/*", "/var/**", "/var/log/?.log", "/var/log/[!a].log"))
    assert not Glob("/var/log/a.log").matches(path)
    assert Glob("/**").may_match_below(path)


@pytest.mark.parametrize(("inner", "length"), [("[!é]" * 240, 240), ("**?" * 320, 320), ("?" * 980, 980)])
def test_the_longest_globs_are_compiled(inner: str, length: int) -> None:
    glob = Glob("/" + "{" * 20 + inner + "}" * 20)
    assert glob.matches("/" + "x" * length)
    assert not glob.matches("/" + "x" * (length - 1))
