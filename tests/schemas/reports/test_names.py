"""Names that people give, and what each means."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.names import (
    ambiguous,
    application_name,
    begins_id,
    given_world_name,
    job_name,
    meant,
    near_names,
    unique_job_names,
    unique_world_names,
    world_name,
)

WORLD = "arn:aws:robomaker:us-east-1:000000000000:world/"
SCOUT = {"robotApplications": [{"application": "arn:aws:robomaker:us-east-1:000000000000:robot-application/scout/1"}]}


def test_a_world_is_its_template_and_number() -> None:
    assert world_name("flat", "generation-82856b0yq33y/world-3") == "flat 3"
    assert world_name("two  rooms\n", "generation-82856b0yq33y/world-12") == "two rooms 12"
    for unnamed in (None, "", "  "):
        assert world_name(unnamed, "generation-82856b0yq33y/world-3") == "generation-82856b0yq33y/world-3"
    assert world_name("flat", "import-82856b0yq33y") == "import-82856b0yq33y"


def test_a_given_name_has_single_blanks_and_letters_of_any_script() -> None:
    assert given_world_name("  Tante  Ernas Küche\t2 ") == "Tante Ernas Küche 2"
    assert given_world_name("x" * 100) == "x" * 100
    for like_an_id in ("import-kitchen", "import", "room-82856b0yq33y", "flat 3", "8285"):
        assert given_world_name(like_an_id) == like_an_id


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "0 characters; 1 to 100 would be right"),
        (" \t", "0 characters"),
        ("x" * 101, "101 characters; 1 to 100"),
        ("a\x1b[2Jb", r"remove U\+001B"),
        ("a\udc80b", r"remove U\+DC80"),
        (WORLD + "import-82856b0yq33y", "taken for an ARN or an id"),
        ("import-82856b0yq33y", "taken for an ARN or an id"),
        ("generation-82856b0yq33y/world-3", "taken for an ARN or an id"),
    ],
)
def test_a_text_that_cannot_name_a_world_is_refused(name: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        given_world_name(name)


def test_a_job_is_its_application_and_world() -> None:
    simulation = {"simulationApplications": [{"application": "indoor-navigation"}]}
    assert application_name(SCOUT | simulation) == "scout"
    assert application_name(simulation) == "indoor-navigation"
    assert application_name({}) is None
    assert job_name("scout", "flat 3") == "scout in flat 3"
    assert job_name("scout", None) == "scout"
    assert job_name(None, None) == ""


def test_worlds_of_one_name_carry_what_made_them() -> None:
    arns = [f"{WORLD}generation-{maker}/world-3" for maker in ("82856b0yq33y", "8285zzzzzzzz", "1111zzzzzzzz")]
    names = unique_world_names(dict.fromkeys(arns, "flat 3") | {f"{WORLD}generation-9/world-1": "flat 1"})
    assert list(names.values()) == [
        "flat 3 (generation-82856)",
        "flat 3 (generation-8285z)",
        "flat 3 (generation-1111)",
        "flat 1",
    ]


def test_jobs_of_one_name_carry_the_parameters_in_which_they_differ() -> None:
    def request(**variables: str) -> dict[str, object]:
        return {"robotApplications": [{"application": "scout", "launchConfig": {"environmentVariables": variables}}]}

    requests = [request(SPEED="1", ARM="a"), request(SPEED="2", ARM="a"), request(SPEED="9", ARM="b")]
    names = ["scout in flat 1", "scout in flat 1", "scout in flat 2"]
    assert unique_job_names(names, requests) == ["scout in flat 1, SPEED=1", "scout in flat 1, SPEED=2", names[2]]
    assert unique_job_names(["scout", "scout"], [{}, {}]) == ["scout", "scout (2)"]
    secret = [request(API_TOKEN="one"), request(API_TOKEN="two")]
    assert unique_job_names(["scout", "scout"], secret) == ["scout", "scout (2)"]


_NAMES = st.sampled_from(["scout", "scout (2)", "scout, seed=1", "scout in flat 1", ""])


@given(st.lists(st.tuples(_NAMES, st.dictionaries(st.sampled_from(["seed", "step"]), st.integers(0, 2)))))
def test_no_two_jobs_of_a_run_have_the_same_name(jobs: list[tuple[str, dict[str, int]]]) -> None:
    names = unique_job_names([name for name, _ in jobs], [settings for _, settings in jobs])
    assert len(set(names)) == len(jobs)
    assert all(name.startswith(given) for name, (given, _) in zip(names, jobs, strict=True))


@given(st.dictionaries(st.from_regex(r"generation-[ab]{4,6}/world-[12]", fullmatch=True), _NAMES))
def test_no_two_worlds_have_the_same_name(worlds: dict[str, str]) -> None:
    names = unique_world_names({WORLD + each: name for each, name in worlds.items()})
    assert len(set(names.values())) == len(worlds)


def test_a_text_means_an_id_a_name_or_the_beginning_of_an_id() -> None:
    known = {"sim-82856b0yq33y": ["scout in flat 1"], "sim-8285zzzzzzzz": ["scout in flat 2"], "sim-1": ["sim-8285"]}
    first, second, third = known
    assert meant(first, known) == [first]
    assert meant("scout in flat 2", known) == [second]
    assert meant("sim-82856", known) == meant("82856", known) == [first]
    assert meant("8285", known) == [first, second]
    assert meant("sim-8285", known) == [third], "a whole name comes before the beginning of an id"
    assert meant("828", known) == meant("sim-", known) == meant("", known) == meant("scout in flat", known) == []


def test_the_beginning_of_a_worlds_id_is_that_of_its_maker() -> None:
    world = "generation-82856b0yq33y/world-2"
    assert begins_id("generation-8285/world-2", world)
    assert begins_id("8285/world-2", world)
    assert begins_id("generation-8285", world)
    assert not begins_id("generation-8285/world-", world)
    assert not begins_id("generation-8285/world-21", world)
    assert not begins_id("template-8285/world-2", world)


def test_messages_name_the_candidates_and_what_is_near() -> None:
    several = [f"sim-{number}" for number in range(7)]
    text = ambiguous("scout", "jobs", several)
    assert text.startswith("'scout' may be any of 7 jobs: sim-0; sim-1; ")
    assert text.endswith("sim-4; and 2 more; name one by its id")
    assert near_names("scout in flat 4", ["scout in flat 3", "other"]) == "; did you mean 'scout in flat 3'?"
    assert near_names("zzz", ["scout"]) == ""
    for written in ("Kuche", "kuche", "KÜCHE", "KUCHE", "Ku\u0308ch"):
        assert near_names(written, ["flat 1", "Küche"]) == "; did you mean 'Küche'?", written


def test_given_names_that_look_the_same_are_the_same() -> None:
    """Else an import would not notice that its name is taken, and specifications would go on with the older world."""
    assert given_world_name("cafe\u0301") == given_world_name("caf\u00e9") == "caf\u00e9"
    for unseen in ("flat\u200b", "fl\u00adat", "\u202etalf"):
        with pytest.raises(ValueError, match=r"remove U\+"):
            given_world_name(unseen)
    assert given_world_name("👩\u200d🚀") == "👩\u200d🚀", "joined signs show"
