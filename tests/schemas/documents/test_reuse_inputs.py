"""The inputs by which results are found again: any change of one is another key, the order of members is none."""

import copy
import json
import random
from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.documents.reuse_inputs import ReuseInputs, in_short
from prefect_robomaker.schemas.documents.simulation_jobs import MadeOf, ResolvedDataSource, SimulationJobDocument

TEXT = st.text(max_size=8)
VALUES = st.recursive(
    st.one_of(st.booleans(), st.integers(-9, 9), st.floats(-2, 2), TEXT),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(TEXT, inner, max_size=3)),
    max_leaves=6,
)
LAUNCH = st.fixed_dictionaries({"environmentVariables": st.dictionaries(TEXT, TEXT, max_size=3)})
CONFIG = st.fixed_dictionaries({"application": TEXT, "launchConfig": LAUNCH})
REQUESTS = st.fixed_dictionaries(
    {"maxJobDurationInSeconds": st.integers(1, 9), "robotApplications": st.lists(CONFIG, min_size=1, max_size=1)},
    optional={"loggingConfig": st.dictionaries(TEXT, VALUES, max_size=2), "compute": VALUES},
)
SOURCE = st.builds(
    lambda name, etag: ResolvedDataSource.model_validate(
        {"name": name, "s3Bucket": "data", "s3Keys": [{"s3Key": "a", "etag": etag}]}
    ),
    TEXT,
    TEXT,
)
DOCUMENTS = st.builds(
    SimulationJobDocument,
    request=REQUESTS,
    seed=st.integers(0, 9),
    video=st.sampled_from(["none", "on-failure", "always"]),
    requirements=st.lists(st.dictionaries(TEXT, VALUES, max_size=2), max_size=2),
    data_sources=st.lists(SOURCE, max_size=2),
)
MADE_OF = st.builds(
    MadeOf,
    world=st.none() | TEXT,
    robot=st.none() | TEXT,
    simulation=st.none() | TEXT,
    versions=st.dictionaries(TEXT, TEXT, max_size=3),
)
INPUTS = st.builds(ReuseInputs.of, DOCUMENTS, MADE_OF)


def shuffled(value: Any, chance: random.Random) -> Any:
    """The same value, members of all objects in another order."""
    if isinstance(value, dict):
        names = list(value)
        chance.shuffle(names)
        return {name: shuffled(value[name], chance) for name in names}
    return [shuffled(each, chance) for each in value] if isinstance(value, list) else value


def exact(inputs: ReuseInputs) -> str:
    """All of it as text; `True` and `1` are equal in Python, and are not here."""
    return json.dumps(inputs.model_dump(mode="json"), sort_keys=True)


@examples(50)
@given(INPUTS, INPUTS)
def test_the_key_is_the_same_if_and_only_if_all_inputs_are(one: ReuseInputs, other: ReuseInputs) -> None:
    assert (one.key == other.key) == (exact(one) == exact(other))
    assert (one.key == other.key) == (not other.changes_since(one))
    assert one.key == ReuseInputs.model_validate_json(one.model_dump_json()).key


@examples(50)
@given(INPUTS, st.data())
def test_a_change_of_any_member_is_another_key(inputs: ReuseInputs, data: st.DataObject) -> None:
    document = inputs.model_dump(mode="json")
    before = json.dumps(document, sort_keys=True)
    place: Any = document
    path: Any = data.draw(st.sampled_from(sorted(document)), label="member")
    while isinstance(place[path], dict | list) and place[path]:
        place = place[path]
        options = range(len(place)) if isinstance(place, list) else sorted(place)
        path = data.draw(st.sampled_from(list(options)), label="inside")
    place[path] = {str: "another", int: 77, dict: {"more": "1"}, list: [{"more": 1}]}.get(type(place[path]), "another")
    if json.dumps(document, sort_keys=True) == before:
        return
    if path == "seed" and not isinstance(document["seed"], int):
        return
    changed = ReuseInputs.model_validate(document)

    assert changed.key != inputs.key
    assert changed.changes_since(inputs)


@examples(50)
@given(INPUTS, st.randoms(use_true_random=False))
def test_the_order_of_members_changes_nothing(inputs: ReuseInputs, chance: random.Random) -> None:
    again = ReuseInputs.model_validate(shuffled(inputs.model_dump(mode="json"), chance))

    assert again.key == inputs.key
    assert not again.changes_since(inputs)


@examples(50)
@given(DOCUMENTS, MADE_OF, TEXT)
def test_names_of_what_is_compared_by_content_change_nothing(
    document: SimulationJobDocument, made_of: MadeOf, name: str
) -> None:
    request = copy.deepcopy(document.request)
    request["robotApplications"][0] |= {"application": name, "applicationVersion": "2"}
    request |= {"tags": {"robomaker:seed": "1"}, "clientRequestToken": name, "seed": 5}
    renamed = document.model_copy(update={"request": request})

    assert ReuseInputs.of(renamed, made_of).key == ReuseInputs.of(document, made_of).key
    assert request["robotApplications"][0]["application"] == name, "nothing was changed"


@pytest.mark.parametrize(
    ("member", "value", "words"),
    [
        ("seed", 4, "seed: 3 is now 4"),
        ("world", "other", "the world has changed"),
        ("versions", {"mujoco": "3.18.0"}, 'versions.mujoco: "3.17.0" is now "3.18.0"'),
        ("request", {"maxJobDurationInSeconds": 9}, "maxJobDurationInSeconds: 5 is now 9"),
        ("video", "always", 'video: "none" is now "always"'),
    ],
)
def test_changes_in_words(member: str, value: Any, words: str) -> None:
    document = SimulationJobDocument(request={"maxJobDurationInSeconds": 5}, seed=3)
    inputs = ReuseInputs.of(document, MadeOf(world="w", versions={"mujoco": "3.17.0"}))

    assert inputs.model_copy(update={member: value}).changes_since(inputs) == [words]


def test_changes_of_secrets_are_told_without_them() -> None:
    def inputs(**variables: str) -> ReuseInputs:
        launch = {"launchConfig": {"environmentVariables": variables}}
        return ReuseInputs.of(SimulationJobDocument(request={"robotApplications": [launch]}, seed=3), MadeOf())

    [changed] = inputs(X_TOKEN="new").changes_since(inputs(X_TOKEN="old"))
    [added] = inputs(A="1", X_TOKEN="new").changes_since(inputs(A="1"))

    assert changed.endswith("environmentVariables.X_TOKEN: the secret has changed")
    assert added.endswith('environmentVariables.X_TOKEN: absent is now "(secret)"')


def test_many_changes_are_cut_short() -> None:
    assert in_short(["a", "b", "c"]) == "a; b; c"
    assert in_short(["a", "b", "c", "d", "e"]) == "a; b; c; and 2 more"
