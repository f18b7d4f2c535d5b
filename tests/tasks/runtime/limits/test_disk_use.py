"""What runs write to the disk, measured in real folders, and real runs that write too much."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from helpers.paths import BUNDLES
from helpers.run_processes import never, processes_with
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunOutcome, RunPlan
from prefect_robomaker.schemas.runs.programs import ComputeLimits, FoundFiles, ProgramPlan, RunStop
from prefect_robomaker.tasks.runtime.limits.disk_use import DiskMeter, in_gb
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

Plan = Callable[..., RunPlan]
MakeProgram = Callable[..., ProgramPlan]
ProgramsPlan = Callable[..., RunPlan]
TROUBLE = BUNDLES / "trouble"
MB = 10**6
SMALL = ComputeLimits(disk_bytes=20 * MB)
FILL = """
import os, sys, time
from pathlib import Path
folder = Path(os.environ["ROBOMAKER_OUTPUT_DIR"])
(folder / "deep").mkdir()
(folder / "deep" / "big.bin").write_bytes(bytes(15_000_000))
(folder / "small.bin").write_bytes(bytes(9_000_000))
"""


def write(path: Path, size: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(os.urandom(size))


def looks(meter: DiskMeter, now: list[float], seconds: float) -> bool:
    """Looks ten times a second, by a clock that stands still meanwhile; says whether it was too much."""
    found = False
    for _ in range(round(seconds * 10)):
        found = found or meter.look()
        now[0] += 0.1
    return found


class TestMeter:
    def test_folders_count_together_and_the_biggest_files_are_named(self, tmp_path: Path) -> None:
        now = [0.0]
        folders = {tmp_path / "output": "output", tmp_path / "root": ""}
        meter = DiskMeter(folders, 3 * MB, clock=lambda: now[0])
        write(tmp_path / "output/a/b.bin", 2 * MB)
        write(tmp_path / "elsewhere/map.bin", 9 * MB)
        (tmp_path / "root").mkdir()
        (tmp_path / "root/link").symlink_to(tmp_path / "elsewhere")
        assert not looks(meter, now, 3)
        assert meter.last_look() is None

        write(tmp_path / "root/home/robomaker/c.bin", 1_500_000)

        assert looks(meter, now, 3)
        said = meter.last_look()
        assert said is not None
        assert said.startswith("3 MB of disk are allowed, and it used 3.5")
        assert "; the biggest files are output/a/b.bin (2 MB), /home/robomaker/c.bin (1.5 MB)" in said

    def test_what_was_too_much_is_told_also_when_it_is_gone(self, tmp_path: Path) -> None:
        now = [0.0]
        meter = DiskMeter({tmp_path: "output"}, MB, clock=lambda: now[0])
        write(tmp_path / "x", 2 * MB)
        assert looks(meter, now, 3)
        (tmp_path / "x").unlink()
        said = meter.last_look()
        assert said is not None
        assert said.startswith("1 MB of disk are allowed, and it used 2")

    def test_holes_are_free_and_empty_files_are_not(self, tmp_path: Path) -> None:
        meter = DiskMeter({tmp_path: "output"}, MB)
        with (tmp_path / "sparse").open("wb") as file:
            file.truncate(10**12)
        assert meter.last_look() is None
        for number in range(300):
            (tmp_path / str(number)).touch()
        assert meter.last_look() is not None

    def test_no_limit_and_no_folder(self, tmp_path: Path) -> None:
        write(tmp_path / "x", 1000)
        for meter in (DiskMeter({tmp_path: "x"}, None), DiskMeter({tmp_path / "gone": "x"}, 1)):
            assert not meter.look()
            assert meter.last_look() is None

    def test_a_large_tree_is_walked_in_slices(self, tmp_path: Path) -> None:
        for folder in range(40):
            (tmp_path / str(folder)).mkdir()
            for number in range(100):
                (tmp_path / str(folder) / str(number)).touch()
        meter = DiskMeter({tmp_path: "output"}, 4000 * 4096 - 1, free=lambda _: 10**12)  # others write to the disk too
        time.sleep(1.05)
        count = 0
        found = False
        while not found:
            found = meter.look()
            count += 1
            meter._next_look_s = 0.0  # pyright: ignore[reportPrivateUsage] - as if a tenth of a second were over
            assert count < 1000
        assert count > 3

    @pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="there is no disk to which only this test writes")
    def test_it_is_looked_at_once_when_the_disk_loses_space_quickly(self) -> None:
        with TemporaryDirectory(dir="/dev/shm") as folder:
            now = [0.0]
            meter = DiskMeter({Path(folder): "output"}, 20 * MB, clock=lambda: now[0])
            assert not looks(meter, now, 1.1)
            assert not meter.look()  # it was walked; the next time would be in a second
            write(Path(folder, "much.bin"), 30 * MB)
            now[0] += 0.1
            assert meter.look()

    @given(st.lists(st.integers(0, 100_000), max_size=8), st.integers(1, 400_000))
    def test_there_is_too_much_exactly_if_the_sum_is(
        self, tmp_path_factory: pytest.TempPathFactory, sizes: list[int], limit: int
    ) -> None:
        folder = tmp_path_factory.mktemp("tree")
        for number, size in enumerate(sizes):
            write(folder / ("d" * (number % 3 + 1)) / str(number), size)
        used = sum(max(path.stat().st_blocks * 512, 4096) for path in folder.rglob("*") if path.is_file())
        assert (DiskMeter({folder: "x"}, limit).last_look() is not None) == (used > limit)

    @pytest.mark.parametrize(
        ("count", "text"), [(128 * 10**9, "128 GB"), (1_254_000_000, "1.25 GB"), (20_000_000, "20 MB")]
    )
    def test_bytes_in_words(self, count: int, text: str) -> None:
        assert in_gb(count) == text


def reason_of(outcome: RunOutcome, code: str, *, finished: bool = True) -> str:
    assert (outcome.status, outcome.failure_code, outcome.finished) == ("Failed", code, finished)
    return outcome.failure_reason or ""


class TestRuns:
    def test_a_program_that_goes_on_is_ended(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        plan = plan_programs(program(FILL + "print('full', flush=True); time.sleep(1000)"), compute=SMALL)
        reason = reason_of(launcher.run(plan, never), "RobotApplicationCrash")
        assert reason.startswith(
            "Robot application driver (program robot) used too much: 20 MB of disk are allowed, and it used 24"
        )
        assert "; the biggest files are output/deep/big.bin (15 MB), output/small.bin (9 MB)\n" in reason
        assert reason.endswith("full")
        assert processes_with(str(tmp_path)) == []

    def test_one_that_has_ended_by_then_has_failed_all_the_same(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        plan = plan_programs(program(FILL), compute=SMALL)
        assert "20 MB of disk" in reason_of(launcher.run(plan, never), "RobotApplicationCrash")
        assert (plan.output_dir / "result.json").exists()

    def test_home_and_tmp_count_and_so_do_tools(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        command = 'mkdir -p "$HOME/bags"; head -c 25000000 /dev/zero > "$HOME/bags/a.bag"; sleep 1000'
        tool = program("", name="simulation-bags", kind="tool", role="simulation", argv=["/bin/bash", "-c", command])
        (tmp_path / "run-1/root/home/robomaker").mkdir(parents=True)
        plan = plan_programs(
            program("import time; time.sleep(1000)"), tool, compute=SMALL, root_dir=tmp_path / "run-1/root"
        )
        reason = reason_of(launcher.run(plan, never), "SimulationApplicationCrash")
        assert reason.startswith("Tool bags of simulation application arena used too much: 20 MB of disk are allowed")
        assert "/home/robomaker/bags/a.bag (25 MB)" in reason

    def test_an_episode(self, launcher: Launcher, make_plan: Plan) -> None:
        arena = ApplicationPlan(
            role="simulation", name="arena", attribute="trouble.faults.writing_too_much", path=TROUBLE
        )
        plan = make_plan(simulation_application=arena, compute=SMALL)
        reason = reason_of(launcher.run(plan, never), "SimulationApplicationCrash", finished=False)
        assert reason.startswith("Simulation application arena used too much: 20 MB of disk are allowed")
        assert "output/data-0.bin" in reason

    def test_a_file_without_a_path_cannot_grow_without_end(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        """Deleted while it is open, it is in no folder any more."""
        command = "exec 7> x; rm x; head -c 30000000 /dev/zero >&7; exec sleep 1000"
        plan = plan_programs(program("", argv=["/bin/bash", "-c", command]), compute=SMALL)
        reason = reason_of(launcher.run(plan, never), "RobotApplicationCrash")
        assert "20 MB of disk are allowed, and it used 30" in reason
        assert ", 30 MB of it in files that were deleted and still open" in reason

    def test_memory_and_holes_may_be_larger(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        """Files that are memory, and a database that reserves addresses."""
        code = """
import os, tempfile, time
memory = os.memfd_create("pictures")
os.ftruncate(memory, 30_000_000)
os.posix_fallocate(memory, 0, 30_000_000)
with tempfile.TemporaryFile(dir="/dev/shm") as shared, open("data.mdb", "wb") as database:
    shared.truncate(30_000_000)
    os.posix_fallocate(shared.fileno(), 0, 30_000_000)
    database.truncate(10**12)
    database.seek(10**12 - 1)
    database.write(b"x")
    time.sleep(1.5)
"""
        outcome = launcher.run(plan_programs(program(code), compute=SMALL), never)
        assert (outcome.status, outcome.failure_reason) == ("Completed", None)

    def test_what_was_there_before_does_not_count(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        """Data at a destination, a copied bundle, what an image has in its home."""
        root = tmp_path / "run-1/root"
        write(root / "home/robomaker/maps/big.bin", 30 * MB)
        write(root / "opt/robomaker/datasources/maps/more.bin", 15 * MB)
        write(tmp_path / "application/weights.bin", 15 * MB)
        folders = {"root_dir": root, "data_dir": root / "opt/robomaker/datasources", "compute": SMALL}
        quiet = program("import time; time.sleep(1.3)", folder=tmp_path / "application")
        assert launcher.run(plan_programs(quiet, **folders), never).status == "Completed"

        code = "import os; open(os.environ['HOME'] + '/x.bin', 'wb').write(bytes(25_000_000))"
        filling = program(code, folder=tmp_path / "application")
        reason = reason_of(
            launcher.run(plan_programs(filling, run_id="run-2", **folders), never), "RobotApplicationCrash"
        )
        assert "20 MB of disk are allowed, and it used 25 MB" in reason
        assert reason.split("; the biggest files are ")[1].splitlines()[0] == "/home/robomaker/x.bin (25 MB)"

    def test_what_is_put_among_the_data_counts(
        self,
        launcher: Launcher,
        program: MakeProgram,
        plan_programs: ProgramsPlan,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")  # in a box, data are read-only
        data = tmp_path / "run-1/root/opt/robomaker/datasources"
        write(data / "map.bin", 30 * MB)
        data.chmod(0o500)
        code = """
import os, time
from pathlib import Path
data = Path(os.environ["ROBOMAKER_DATA_DIR"])
data.chmod(0o700)
(data / "mine.bin").write_bytes(bytes(25_000_000))
time.sleep(1000)
"""
        plan = plan_programs(program(code), compute=SMALL, root_dir=tmp_path / "run-1/root", data_dir=data)
        reason = reason_of(launcher.run(plan, never), "RobotApplicationCrash")
        assert "it used 25 MB; the biggest files are /opt/robomaker/datasources/mine.bin (25 MB)" in reason

    def test_a_run_that_goes_on_knows_what_was_there_before_its_first_attempt(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        plan = plan_programs(program("pass"), compute=SMALL)
        write(plan.output_dir / "of-the-first-attempt.bin", 25 * MB)
        assert launcher.run(plan, never).status == "Completed"
        plan = plan.model_copy(update={"found": FoundFiles(size_bytes=0, at_s=0.0)})
        assert "it used 25" in reason_of(launcher.run(plan, never), "RobotApplicationCrash")

    def test_what_only_a_containers_root_may_read_is_found_when_it_is_settled(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        """As if files of another user were handed over: they come into sight when all code has stopped."""
        sandbox = tmp_path / "run-1/robot-root"
        sandbox.mkdir(parents=True)
        client = program("", argv=["true"], folder=sandbox, cleanup_argv=["true"])
        outcome = launcher.run(
            plan_programs(client, compute=SMALL),
            never,
            on_stopped=lambda: write(sandbox / "home/x.bin", 25 * MB),
        )
        reason = reason_of(outcome, "RobotApplicationCrash")
        assert reason.startswith("Robot application driver (program robot) used too much: 20 MB of disk are allowed")
        assert "robot-root/home/x.bin (25 MB)" in reason

    def test_a_canceled_run_is_canceled(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        plan = plan_programs(program(FILL + "print('on', flush=True); time.sleep(1000)"), compute=SMALL)
        log = plan.output_dir / "logs/robot.stdout.log"
        outcome = launcher.run(plan, lambda: RunStop.CANCELED if log.exists() and log.read_text() else None)
        assert outcome.status == "Canceled"

    def test_enough(self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
        plan = plan_programs(program(FILL), compute=ComputeLimits(disk_bytes=30 * MB))
        assert launcher.run(plan, never).status == "Completed"
