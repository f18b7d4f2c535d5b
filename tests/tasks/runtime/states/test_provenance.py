"""Every run says what its numbers depend on."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.policies import POLICY_FACTORY
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.schemas.runs.provenance import PROVENANCE_FILE, Provenance
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.states.provenance import digest_of_folder, machine_facts, note_run
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

CARTPOLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"


@pytest.fixture
def cartpole(make_plan: Callable[..., RunPlan]) -> Callable[..., RunPlan]:
    def plan(path: Path | None = CARTPOLE, **members) -> RunPlan:
        applications = {
            "simulation_application": ApplicationPlan(
                role="simulation", name="pole", attribute="my_cartpole.arena.make_environment", path=path
            ),
            "robot_application": ApplicationPlan(
                role="robot", name="balancer", attribute="my_cartpole.agent.make_agent", path=path
            ),
        }
        return make_plan(**{"record": False, **applications, **members})

    return plan


def read(plan: RunPlan) -> Provenance:
    return Provenance.model_validate_json((plan.output_dir / PROVENANCE_FILE).read_bytes())


def result_of(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def test_the_digest_repeats_with_the_seed_and_with_it_only(
    launcher: Launcher, cartpole: Callable[..., RunPlan]
) -> None:
    plans = [cartpole(run_id=name, seed=seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))]
    for plan in plans:
        assert launcher.run(plan, lambda: None).status == "Completed"
    first, again, other = (result_of(plan).state_digest for plan in plans)
    assert first == again != other
    provenance = read(plans[0])
    assert provenance.digest is not None
    assert provenance.digest.value == first
    assert provenance.digest.until_s == pytest.approx(result_of(plans[0]).sim_time_s)
    assert (provenance.ended_by, provenance.plan.seed) == ("environment", 1)
    assert [joint.name for joint in provenance.joints] == ["slider", "hinge"]
    assert len(provenance.model_sha256 or "") == 64
    assert provenance.machine == machine_facts()


def test_a_changed_policy_has_another_digest(
    launcher: Launcher, cartpole: Callable[..., RunPlan], tmp_path: Path
) -> None:
    changed = shutil.copytree(CARTPOLE, tmp_path / "changed", ignore=shutil.ignore_patterns("__pycache__"))
    (changed / "my_cartpole" / "weights.bin").write_bytes(b"\x01\x02")
    plans = [cartpole(run_id="a"), cartpole(run_id="b", path=changed)]
    for plan in plans:
        launcher.run(plan, lambda: None)
    one, other = ([each.sha256 for each in read(plan).applications] for plan in plans)
    assert one[0] == one[1] == digest_of_folder(CARTPOLE)
    assert other[0] == other[1] == digest_of_folder(changed) != one[0]
    assert result_of(plans[0]).state_digest == result_of(plans[1]).state_digest


@pytest.mark.parametrize(
    ("policy", "file", "members"),
    [
        ("pole_policy:act", "pole_policy.py", {}),
        ("pole_policy:act", "pole_policy.py", {"trials": Trials(seeds=2)}),
        ("/data/act.py:act", "data/act.py", {}),
        ("/data/act.py:act", "data/act.py", {"path": CARTPOLE}),
    ],
)
def test_an_application_has_another_digest_with_another_policy_outside_its_archive(
    launcher: Launcher, cartpole: Callable[..., RunPlan], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    policy: str, file: str, members: dict[str, Any],
) -> None:  # fmt: skip
    path = members.get("path")
    given = {name: value for name, value in members.items() if name != "path"}
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "data").mkdir()
    digests = []
    for number in (0, 1):
        (tmp_path / file).write_text(f"def act(seen):\n    return [0.0]  # {number}\n")
        robot = ApplicationPlan(role="robot", name=policy, attribute=POLICY_FACTORY, policy=policy, path=path)
        for again in "ab":
            plan = cartpole(run_id=f"{again}{number}", robot_application=robot, root_dir=tmp_path, **given)
            assert launcher.run(plan, lambda: None).status == "Completed"
            digests += [each.sha256 for each in read(plan).applications if each.role == "robot"]
    assert digests[0] == digests[1] != digests[2] == digests[3]
    assert "" not in digests


def test_a_run_that_fails_has_one_and_one_without_physics_has_no_digest(
    launcher: Launcher, make_plan: Callable[..., RunPlan]
) -> None:
    fine, failing = make_plan(run_id="a"), make_plan(run_id="b", agent="make_failing_agent")
    assert launcher.run(fine, lambda: None).status == "Completed"
    assert launcher.run(failing, lambda: None).status == "Failed"
    assert result_of(fine).state_digest is None
    assert (read(fine).digest, read(fine).ended_by) == (None, "environment")
    assert (read(failing).digest, read(failing).ended_by) == (None, None)


def test_variables_of_programs_are_not_written_down(
    launcher: Launcher, cartpole: Callable[..., RunPlan], tmp_path: Path
) -> None:
    """Those of a container's program are what its engine is called with: credentials of registries, for one."""
    tool = ProgramPlan(
        name="simulation-idle", role="simulation", kind="tool", argv=["sleep", "60"], folder=tmp_path,
        environment={"DOCKER_AUTH_CONFIG": "s3cr3t"},
    )  # fmt: skip
    plan = cartpole(programs=[tool], checkpoint_dir=tmp_path / "checkpoints", checkpoint_every_s=1.0)
    assert launcher.run(plan, lambda: None).status == "Completed"
    assert read(plan).plan.programs == [tool.model_copy(update={"environment": {}})]
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert [path for path in written if b"s3cr3t" in path.read_bytes()] == []


def test_this_machine_says_what_matters() -> None:
    facts = machine_facts()
    assert set(facts.versions) == {"mujoco", "dm_control", "numpy", "scipy", "prefect_robomaker"}
    assert facts.cpu_model
    assert "glibc" in facts.libc


def test_secrets_are_not_written(make_plan: Callable[..., RunPlan]) -> None:
    secrets = [f"hunter2-{letter}" for letter in "abcde"]
    marked, token, password, login, line = secrets
    plan = make_plan(
        robot_application=ApplicationPlan(role="robot", name="rover", environment_variables={"X_TOKEN": token}),
        programs=[
            ProgramPlan(
                name="robot",
                role="robot",
                kind="application",
                argv=["docker", "run", "-e", f"DB_PASSWORD={password}", "--key", line, "image"],
                folder=Path("/"),
                environment={"DB_PASSWORD": password, "A_TOKEN": line, "URL": f"https://me:{login}@example.com/a"},
            )
        ],
    )

    given = {"MARKED": marked, "ROBOMAKER_SECRETS": "MARKED", "SPEED": "2"}
    plan = plan.model_copy(update={"environment": given})
    plan.output_dir.mkdir(parents=True)
    note_run(plan)

    text = (plan.output_dir / "provenance.json").read_text()
    assert [each for each in secrets if each in text] == []
    assert '"SPEED": "2"' in text
    assert "https://(secret)@example.com/a" in text
    assert plan.programs[0].environment["DB_PASSWORD"] == password  # the run itself has it
