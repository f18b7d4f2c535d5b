"""How arrays lie in messages, and how streams are cut into messages: for all specs, values and cuts."""

import json
import math
import struct
from contextlib import suppress
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from prefect_robomaker.tasks.runtime.agents import agent_client
from prefect_robomaker.tasks.runtime.agents.agent_client import (
    ACTION_HEADER,
    HEADER,
    ITEM_FORMATS,
    OBSERVATION_HEADER,
    FrameBuffer,
    ProtocolError,
)
from prefect_robomaker.tasks.runtime.agents.agent_layout import Layout
from prefect_robomaker.tasks.runtime.agents.agent_protocol import ObservationWriter, read_action
from prefect_robomaker.tasks.runtime.episode.context import ActionError, ObservationError

DTYPES = st.sampled_from(sorted(ITEM_FORMATS)).map(np.dtype)
ARRAYS = DTYPES.flatmap(
    lambda dtype: hnp.arrays(
        dtype,
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
        elements={"allow_nan": False, "allow_infinity": False} if dtype.kind == "f" else None,
    )
)
KEYS = st.text(st.characters(exclude_categories=["Cs"]), max_size=4)
TREES = st.recursive(ARRAYS, lambda children: st.dictionaries(KEYS, children, max_size=4), max_leaves=6)


def spec_of(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: spec_of(item) for key, item in tree.items()}
    return specs.Array(tree.shape, tree.dtype)


def leaves_of(tree: Any) -> list[Any]:
    return [leaf for item in tree.values() for leaf in leaves_of(item)] if isinstance(tree, dict) else [tree]


def bits(array: Any) -> tuple[str, tuple[int, ...], bytes]:
    array = np.asarray(array)
    return array.dtype.name, array.shape, array.tobytes()


def without_empty(tree: Any) -> Any:
    """A dictionary with nothing in it holds no array, so nothing is said of it."""
    if not isinstance(tree, dict):
        return tree
    kept = {key: without_empty(item) for key, item in tree.items()}
    return {key: item for key, item in kept.items() if not isinstance(item, dict) or item}


def same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return isinstance(other, dict) and one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    return bits(one) == bits(other)


def step(observation: Any, reward: Any = 0.5, discount: Any = 1.0) -> dm_env.TimeStep:
    return dm_env.TimeStep(dm_env.StepType.MID, reward, discount, observation)


@examples(40)
@given(TREES)
def test_observations_arrive_as_they_were(tree: Any) -> None:
    layout = Layout(spec_of(tree), OBSERVATION_HEADER.size)
    description = json.loads(json.dumps(layout.describe()))
    writer = ObservationWriter(layout)
    writer.write(3, 1.5, step(tree))
    length, kind = HEADER.unpack_from(writer.message)
    assert (length, kind, len(writer.message)) == (description["size"], 2, length + 8)
    content = bytearray(writer.message[8:])
    assert OBSERVATION_HEADER.unpack_from(content) == (3, 1.5, 0.5, 1.0, 1, 3)
    assert same(without_empty(tree), agent_client._Layout(description).read(content))


@examples(40)
@given(TREES)
def test_actions_arrive_as_they_were(tree: Any) -> None:
    layout = Layout(spec_of(tree), ACTION_HEADER.size)
    content = bytearray(layout.size)
    ACTION_HEADER.pack_into(content, 0, 7)
    agent_client._Layout(json.loads(json.dumps(layout.describe()))).write(tree, content)
    assert same(tree, read_action(layout, memoryview(content), range(7, 8)))


@examples(40)
@given(TREES)
def test_arrays_lie_apart_at_multiples_of_eight(tree: Any) -> None:
    layout = Layout(spec_of(tree), 40)
    end = 40
    for field, leaf in zip(layout.fields, leaves_of(tree), strict=True):
        assert field.offset >= end
        assert field.offset % 8 == 0
        end = field.offset + leaf.nbytes
    assert end <= layout.size < end + 8


@examples(50)
@given(st.lists(st.tuples(st.integers(1, 5), st.binary(max_size=9000)), max_size=6), st.data())
def test_a_stream_is_cut_into_messages_however_it_arrives(messages: list[tuple[int, bytes]], data: Any) -> None:
    stream = b"".join(HEADER.pack(len(content), kind) + content for kind, content in messages)
    frames = FrameBuffer(dict.fromkeys(range(1, 6), 9000))
    found = []
    while stream:
        count = min(data.draw(st.integers(1, len(stream))), len(frames.space()))
        assert count > 0, "there is always room"
        frames.space()[:count] = stream[:count]
        frames.received(count)
        stream = stream[count:]
        while (message := frames.next()) is not None:
            found.append((message[0], bytes(message[1])))
    assert found == messages
    assert frames.pending == 0


@given(st.binary(min_size=8, max_size=200))
def test_rubbish_is_refused_or_read_and_never_asks_for_much_memory(stream: bytes) -> None:
    frames = FrameBuffer({1: 100, 3: 16})
    frames.space()[: len(stream)] = stream
    frames.received(len(stream))
    with suppress(ProtocolError):
        while (message := frames.next()) is not None:
            assert len(message[1]) <= 100
        assert len(frames.space()) <= 8192


class TestSpecs:
    def test_bounds_are_short_where_they_can_be(self) -> None:
        spec = {
            "image": specs.BoundedArray((480, 640, 3), np.uint8, 0, 255),
            "wheels": specs.BoundedArray((2,), np.float64, [-1.0, -np.inf], [np.inf, 2.0]),
            "free": specs.BoundedArray((2,), np.float64, -np.inf, np.inf),
            "tool": specs.DiscreteArray(4),
            "empty": specs.BoundedArray((0,), np.float64, 0, 1),
        }
        arrays = {tuple(each["path"]): each for each in Layout(spec, 8).describe()["arrays"]}
        bounds = {path[0]: (each.get("minimum"), each.get("maximum")) for path, each in arrays.items()}
        assert bounds == {
            "image": (0, 255),
            "wheels": ([-1.0, None], [None, 2.0]),
            "free": (None, None),
            "tool": (0, 3),
            "empty": (None, None),
        }

    def test_members_come_in_the_documented_order(self) -> None:
        array = Layout(specs.BoundedArray((2,), np.float32, 0, 1, name="wheels"), 8).describe()["arrays"][0]
        assert list(array) == ["path", "dtype", "shape", "offset", "minimum", "maximum", "description"]

    @pytest.mark.parametrize("leaf", [specs.StringArray(()), None, "text", specs.Array((1,), complex), object()])
    def test_what_has_no_fixed_size_is_left_out_and_named(self, leaf: Any) -> None:
        layout = Layout({"a": [specs.Array((), bool), leaf]}, 8)
        assert layout.left_out == ["a/1"]
        assert layout.summary() == "a/0: bool[]"
        assert Layout(leaf, 8).left_out == ["all of it"]

    @pytest.mark.parametrize(
        ("spec", "text"),
        [
            ({1: specs.Array((), bool)}, "the key 1; keys have to be text"),
            ({"a": {None: specs.Array((), bool)}}, "a has the key None"),
            (specs.Array((2**15, 2**13), np.float64), "bytes; a message may have 1073741824"),
        ],
    )
    def test_what_cannot_be_sent(self, spec: Any, text: str) -> None:
        with pytest.raises(ValueError, match=text):
            Layout(spec, 8)


class TestObservations:
    LAYOUT = Layout({"a": specs.Array((2,), np.float32), "b": {"c": specs.Array((), np.int32)}}, 40)

    def test_numbers_and_lists_are_as_good_as_arrays(self) -> None:
        writer = ObservationWriter(self.LAYOUT)
        writer.write(
            0, math.nan, step({"a": [1, 2.5], "b": {"c": True}, "more": 1}, reward=None, discount=np.float32(1))
        )
        content = agent_client._Layout(self.LAYOUT.describe()).read(writer.message[8:])
        assert (content["a"].tolist(), content["b"]["c"]) == ([1.0, 2.5], 1)
        _, time_s, reward, discount, _, flags = OBSERVATION_HEADER.unpack_from(writer.message, 8)
        assert math.isnan(time_s)
        assert (reward, discount, flags) == (0.0, 1.0, agent_client.HAS_DISCOUNT)

    @pytest.mark.parametrize(
        ("observation", "text"),
        [
            ({"a": [1, 2]}, "has no b/c"),
            ({"a": [1, 2], "b": {}}, "has no b/c"),
            ({"a": [1, 2], "b": 3}, "has no b/c"),
            (None, "has no a"),
            ({"a": [1], "b": {"c": 1}}, r"the observation a is int64\[1\]; its spec says float32\[2\]"),
            ({"a": [[1, 2]], "b": {"c": 1}}, r"a is int64\[1, 2\]"),
            ({"a": [1, [2]], "b": {"c": 1}}, "a is no array"),
            ({"a": [1, 2], "b": {"c": 0.5}}, r"b/c is float64\[\]; its spec says int32\[\]"),
            ({"a": ["x", "y"], "b": {"c": 0}}, "its spec says float32"),
            ({"a": [None, 1], "b": {"c": 0}}, "a is object"),
        ],
    )
    def test_what_is_not_as_the_spec_says(self, observation: Any, text: str) -> None:
        with pytest.raises(ObservationError, match=text):
            ObservationWriter(self.LAYOUT).write(0, 0.0, step(observation))

    @pytest.mark.parametrize("reward", ["much", np.ones(2), [1]])
    def test_rewards_are_numbers(self, reward: Any) -> None:
        with pytest.raises(ObservationError, match="have to be numbers"):
            ObservationWriter(self.LAYOUT).write(0, 0.0, step({"a": [1, 2], "b": {"c": 1}}, reward=reward))


class TestActions:
    LAYOUT = Layout([specs.Array((2,), np.float32), {"on": specs.Array((), bool)}], 8)

    def content(self, number: int = 5, on: int = 1, *values: float) -> memoryview:
        return memoryview(struct.pack("<Q2f?7x", number, *(values or (1.0, 2.0)), False)[:16] + bytes([on]) + bytes(7))

    def test_have_the_form_of_the_spec(self) -> None:
        action = read_action(self.LAYOUT, self.content(), range(6))
        assert isinstance(action, list)
        assert action[0].tolist() == [1.0, 2.0]
        assert action[1]["on"] is np.True_

    @pytest.mark.parametrize(
        ("content", "text"),
        [
            ({"on": 2}, "the action 1/on has bytes that are neither 0 nor 1"),
            ({"number": 4}, "answers observation 4; it has to answer 5"),
        ],
    )
    def test_wrong_ones(self, content: dict[str, int], text: str) -> None:
        with pytest.raises(ActionError, match=text):
            read_action(self.LAYOUT, self.content(**content), range(5, 6))

    @pytest.mark.parametrize("value", [math.nan, math.inf])
    def test_numbers_that_are_not_finite(self, value: float) -> None:
        with pytest.raises(ActionError, match=r"the action 0 is \[1\.0, (nan|inf)\]; it has to be finite"):
            read_action(self.LAYOUT, self.content(5, 1, 1.0, value), range(5, 6))

    def test_wrong_sizes_are_told_in_full(self) -> None:
        with pytest.raises(ActionError, match=r"3 bytes; it has to have 24: .* 0: float32\[2\], 1/on: bool\[\]"):
            read_action(self.LAYOUT, memoryview(bytes(3)), range(1))
