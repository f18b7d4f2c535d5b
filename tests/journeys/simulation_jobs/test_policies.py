"""Jobs whose robot follows a policy: they repeat to the bit, and fail with one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.networks import write_network

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.job_contents import (
    CurrentApplications,
    contents_of_request,
    imported_packages,
)
from prefect_robomaker.tasks.storage import pack_tar_gz

SUITE = {"name": "General"}


@pytest.fixture
def follower(service: Service, tmp_path: Path) -> str:
    """Name of a robot application whose archive has policies."""
    bundle = tmp_path / "follower"
    (bundle / "nets").mkdir(parents=True)
    write_network(bundle / "nets" / "push.onnx", {"angles": [[-0.05], [0.02]]})
    write_network(bundle / "nets" / "nan.onnx", {"angles": [[np.nan], [0.0]]})
    (bundle / "push.py").write_text("def act(seen):\n    return [-0.05 * seen['angles'][0]]\n")
    pack_tar_gz(bundle, tmp_path / "follower.tar.gz")
    service.store.ensure_bucket("applications")
    service.store.put_file("applications", "follower.tar.gz", tmp_path / "follower.tar.gz")
    source = [{"s3Bucket": "applications", "s3Key": "follower.tar.gz"}]
    call("CreateRobotApplication", {"name": "follower", "sources": source, "robotSoftwareSuite": SUITE}, service)
    return "follower"


@pytest.mark.deep
def test_policies_of_an_archive_repeat_to_the_bit_also_after_the_job_worker_died(
    robomaker: Any, swing: Any, follower: str, service: Service
) -> None:
    robot = {"application": follower, "launchConfig": {}}
    for policy in ("nets/push.onnx", "push.py:act"):
        done = swing(robot=robot, job={"policy": policy})
        assert done["status"] == "Completed", done.get("failureReason")
        assert robomaker("verify", done["name"]).out == "bit-identical: 5 states over 4.000 s\n"
    made_of = service.catalog.get(done["arn"]).document["madeOf"]
    assert made_of["robot"].startswith("archive ")

    killed = swing(robot=robot, job={"policy": "nets/push.onnx"}, KILL_AT="60", ROBOMAKER_CHECKPOINT_EVERY_S="0.5")
    assert killed["status"] == "Completed", killed.get("failureReason")


def test_a_policy_of_a_data_source_or_an_installed_module_needs_no_robot_application(
    robomaker: Any, swing: Any, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service.store.ensure_bucket("nets")
    service.store.put_file("nets", "push.onnx", write_network(tmp_path / "push.onnx", {"angles": [[-0.05], [0.02]]}))
    sources = [{"name": "nets", "s3Bucket": "nets", "s3Keys": ["push.onnx"]}]
    alone = {"robotApplications": None, "dataSources": sources}
    done = swing(job={**alone, "policy": "/opt/robomaker/datasources/nets/push.onnx"})
    assert done["status"] == "Completed", done.get("failureReason")
    assert "robotApplications" not in done
    assert robomaker("verify", done["name"]).code == 0

    installed = tmp_path / "installed"
    installed.mkdir()
    (installed / "pushing_policy.py").write_text("def act(seen):\n    return [-0.05 * seen['angles'][0]]\n")
    monkeypatch.syspath_prepend(str(installed))
    done = swing(job={"robotApplications": None, "policy": "pushing_policy:act"})
    assert done["status"] == "Completed", done.get("failureReason")


def test_what_a_policy_is_decides_whether_results_are_taken_over(
    swing: Any, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Results of another policy must not be taken for those of this one."""
    del swing  # its applications are what the request names
    package = tmp_path / "changing_policy"
    package.mkdir()
    (package / "__init__.py").write_text("def act(seen):\n    return [0.0]\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    request = {
        "simulationApplications": [{"application": "swing", "launchConfig": {"packageName": "swinger"}}],
        "policy": "changing_policy:act",
    }
    before = contents_of_request(request, service)
    (package / "__init__.py").write_text("def act(seen):\n    return [1.0]\n")
    after = contents_of_request(request, service)
    assert before.robot is not None
    assert before.robot.startswith("package ")
    assert after.robot != before.robot
    assert set(imported_packages([request], CurrentApplications(service)) or {}) == {"changing_policy"}
    network = contents_of_request({**request, "policy": "/opt/robomaker/datasources/nets/push.onnx"}, service)
    assert network.versions["onnxruntime"]
    unknown = contents_of_request({**request, "policy": "no_such_policy:act"}, service)
    assert unknown.once_only is not None


def test_a_policy_that_cannot_be_used_fails_with_one_sentence(swing: Any, follower: str, service: Service) -> None:
    robot = {"application": follower, "launchConfig": {}}
    for policy, said in {
        "nets/gone.onnx": "the robot application has no file nets/gone.onnx; the robot application has nets/nan.onnx",
        "nets/nan.onnx": "policy nets/nan.onnx gave array([[nan]], dtype=float32), which is not finite",
        "push.py:walk": "policy push.py:walk: push.py has no walk",
        "pushy:act": "policy pushy:act: the bundle has no package pushy",
    }.items():
        done = swing(robot=robot, job={"policy": policy})
        assert (done["status"], done["failureCode"]) == ("Failed", "RobotApplicationCrash")
        assert said in done["failureReason"]
        assert "Traceback" not in done["failureReason"]

    done = swing(robot={"application": "scout", "launchConfig": {}}, job={"policy": "pushy:act"})
    assert done["failureReason"].endswith(
        "policy pushy:act: robot application scout came with this package and has no modules of yours; leave it out, "
        "and say which robot it is with ROBOMAKER_ROBOT: scout"
    )
    call(
        "CreateRobotApplication",
        {"name": "boxed", "environment": {"uri": "example.com/robot:1"}, "robotSoftwareSuite": SUITE},
        service,
    )
    with pytest.raises(InvalidParameterException, match="boxed is a container image, whose files no policy is read"):
        swing(robot={"application": "boxed", "launchConfig": {}}, job={"policy": "nets/push.onnx"})
    with pytest.raises(InvalidParameterException, match=r"launchConfig\.launchFile both say what drives the robot"):
        swing(job={"policy": "nets/push.onnx"})
