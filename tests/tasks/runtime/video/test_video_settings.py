import pytest

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.video.video_settings import (
    DEFAULTS,
    VideoSettings,
    camera_recording,
    settings_of,
    video_settings,
)


def test_nothing_said_means_640_by_480_at_15() -> None:
    assert video_settings({}) == DEFAULTS == VideoSettings(camera=None, size=None, rate_hz=15)


def test_all_said() -> None:
    variables = {"ROBOMAKER_VIDEO_CAMERA": "both", "ROBOMAKER_VIDEO_SIZE": "320x240", "ROBOMAKER_VIDEO_FPS": "10"}
    assert video_settings(variables) == VideoSettings("both", (320, 240), 10)


@pytest.mark.parametrize(
    ("variable", "value", "right"),
    [
        ("ROBOMAKER_VIDEO_SIZE", "big", "width x height in pixels, such as 320x240"),
        ("ROBOMAKER_VIDEO_SIZE", "321x240", "both even and from 64 to 2048"),
        ("ROBOMAKER_VIDEO_SIZE", "4096x240", "both even and from 64 to 2048"),
        ("ROBOMAKER_VIDEO_SIZE", "", "width x height"),
        ("ROBOMAKER_VIDEO_FPS", "0", "1 to 60"),
        ("ROBOMAKER_VIDEO_FPS", "29.97", "a whole number of pictures per simulated second"),
        ("ROBOMAKER_VIDEO_CAMERA", " ", "follow, top, both, or the name"),
    ],
)
def test_what_cannot_be_is_refused(variable: str, value: str, right: str) -> None:
    with pytest.raises(LaunchError) as caught:
        video_settings({variable: value})
    assert f"{variable} is {value!r}; it has to be" in str(caught.value)
    assert right in str(caught.value)
    assert caught.value.failure_code == "InvalidInput"


def test_the_simulation_applications_variables_go_first(make_plan) -> None:
    robot = ApplicationPlan(role="robot", name="driver", attribute="a.b", environment_variables={
        "ROBOMAKER_VIDEO_FPS": "30", "ROBOMAKER_VIDEO_CAMERA": "top"
    })  # fmt: skip
    plan = make_plan(variables={"ROBOMAKER_VIDEO_FPS": "10"}, robot_application=robot)
    assert settings_of(plan) == VideoSettings("top", None, 10, seed=plan.seed)


def test_an_appearance_is_one_that_there_is(make_plan) -> None:
    lit = make_plan(variables={"ROBOMAKER_APPEARANCE": "random", "ROBOMAKER_RECORD_CAMERA_HZ": "5"})
    assert settings_of(lit).appearance == "random"
    recorded = camera_recording(lit.model_copy(update={"record": True}))
    assert recorded is not None
    assert (recorded.appearance, recorded.seed) == ("random", lit.seed)
    with pytest.raises(LaunchError, match=r"ROBOMAKER_APPEARANCE: appearance 'dusk'.*evening") as caught:
        settings_of(make_plan(variables={"ROBOMAKER_APPEARANCE": "dusk"}))
    assert caught.value.failure_code == "InvalidInput"


def test_a_run_that_cannot_be_filmed_as_asked_is_not_started(launcher: Launcher, make_plan) -> None:
    plan = make_plan(variables={"ROBOMAKER_VIDEO_SIZE": "3x3"}, video="on-failure")
    with pytest.raises(LaunchError, match="ROBOMAKER_VIDEO_SIZE is '3x3'"):
        launcher.run(plan, lambda: None)
