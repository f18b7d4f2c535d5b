"""Documents stored with a run's outputs: `manifest.json`, `provenance.json` and `failure-state.json`."""

from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, Field, JsonValue, model_validator

from ..wire.base import Model, optional
from .plan import RunPlan
from .programs import ApplicationRole

PROVENANCE_FILE = "provenance.json"


class MachineFacts(Model):
    """Facts of a machine (CPU, system, library versions) that can change the last bit of a simulated number."""

    python: str = Field(description="Version of Python, `3.11.9`.")
    system: str = Field(description="Kernel and instruction set, `Linux x86_64`.")
    cpu_model: str = Field(
        description="Name of the processor; processors with the same features may have different names."
    )
    cpu_features: list[str] = Field(
        description="CPU features such as avx2, avx512f and fma by which libraries choose their code."
    )
    libc: str = Field(description="C library, `glibc 2.36`, which computes sines and powers.")
    versions: dict[str, str] = Field(description="Versions of mujoco, dm_control, numpy, scipy and this package.")


class ApplicationDigest(Model):
    """Name and content hash of an application, taken when the run ended."""

    role: ApplicationRole = Field(description="Robot or simulation application.")
    name: str = Field(description="Name of the application in the catalog.")
    attribute: str | None = optional("Dotted path of the application's factory function; absent: it is a program.")
    content: Literal["bundle", "module"] = Field(
        description="Files that are hashed: all of the archive, or the Python files of the installed package; and "
        "those of the job's policy."
    )
    sha256: str = Field(description="SHA-256 over names and contents of the files, in hexadecimal; empty: not loaded.")


class JointPlace(Model):
    """Indices of a joint's values in the simulation's position and velocity vectors."""

    name: str = Field(description="Name of the joint, or of its body if the joint has none.")
    qpos: int = Field(description="Index of the joint's first number in `qpos`.")
    qvel: int = Field(description="Index of the joint's first number in `qvel`.")


class StateDigestSummary(Model):
    """Summary of the hash chain over a run's simulation states; `digest.bin` has every link of it."""

    algorithm: Literal["sha256"] = Field(default="sha256", description="Name of the hash function of the chain.")
    state: Literal["mjSTATE_INTEGRATION"] = Field(
        default="mjSTATE_INTEGRATION",
        description="MuJoCo's name of the hashed state: everything from which integration starts.",
    )
    looks: int = Field(description="Number of links in the hash chain.")
    until_s: float = Field(description="Simulated time of the last link, in seconds.")
    value: str = Field(description="Last link in hexadecimal: equal for runs with the same states.")


class ActionsSummary(Model):
    """Summary of the actions that a robot program sent; `actions.bin` has each of them."""

    mode: Literal["lockstep", "free"] = Field(
        description="Mode of the robot program: whether the simulation waited for each action."
    )
    actions: int = Field(description="Number of actions: one per step, including repeated ones.")
    size_bytes: int = Field(description="Size of the file in bytes.")
    sha256: str = Field(description="SHA-256 of the file, in hexadecimal.")


class Provenance(Model):
    """Provenance of a run: its plan, machine and digests, so that it can be repeated and compared."""

    schema_version: Literal[1] = Field(default=1, description="Format version of this document.")
    plan: RunPlan = Field(description="Plan of the run; its folders are those of its machine.")
    machine: MachineFacts = Field(description="Facts about the machine of the run.")
    world_sha256: str | None = optional("SHA-256 over names and bytes of the world bundle's files; absent: no world.")
    applications: list[ApplicationDigest] = Field(
        default=[],
        description="Digests of the applications; empty until the run ends, and of a run that was canceled. The image "
        "id of an application that is a container is in the plan.",
    )
    imported: dict[str, str] = Field(
        default={},
        description="Code that the run imported from outside its applications, this package and Python, by outermost "
        "name: the version of an installed distribution, else a digest of its Python files; empty until the run ends.",
    )
    model_sha256: str | None = optional(
        "SHA-256 of the compiled model, independent of file paths; absent: no physics, or not begun."
    )
    positions: int = Field(default=0, description="Number of positions in the model, `nq`.")
    joints: list[JointPlace] = Field(default=[], description="Joints of the model.")
    digest: StateDigestSummary | None = optional(
        "Digest of its states; absent until it ends, and of runs that have none."
    )
    actions: ActionsSummary | None = optional(
        "Summary of `actions.bin`; absent until the run ends, and if there is no robot program."
    )
    ended_by: str | None = optional(
        "Cause of the end as in `result.json`; absent: failed, not ended, or only programs."
    )
    resumed_at_s: list[float] = Field(
        default=[], description="Simulated times of the checkpoints from which the run was resumed."
    )


def _inside(path: str) -> str:
    """Returns a path; raises ValueError if it could lead out of the folder into which it is downloaded."""
    if "\0" in path or any(part in ("", ".", "..") for part in path.split("/")):
        raise ValueError(f"{path!r} has to be a relative path without empty, '.' and '..' components")
    return path


class ManifestFile(Model):
    """One output file in a manifest: name, size and hash."""

    path: Annotated[str, AfterValidator(_inside)] = Field(description="Path relative to the manifest's folder.")
    size_bytes: int = Field(ge=0, description="Size of the file in bytes.")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the content, in hexadecimal.")


class Manifest(Model):
    """List of the output files that were uploaded together, with facts about their run."""

    schema_version: Literal[1] = Field(default=1, description="Format version of this document.")
    created_at: AwareDatetime = Field(description="When the files were published.")
    about: dict[str, JsonValue] = Field(description="Facts about the origin of the files: job, run, status and so on.")
    files: list[ManifestFile] = Field(description="All files, in the order of their paths.")

    @model_validator(mode="after")
    def _paths_are_unique(self) -> "Manifest":
        paths = [file.path for file in self.files]
        if len(set(paths)) < len(paths):
            twice = sorted({path for path in paths if paths.count(path) > 1})
            raise ValueError(f"files name {', '.join(twice)} more than once")
        return self


FAILURE_STATE_FILE = "failure-state.json"
FAILURE_VECTOR_FILE = "failure-state.npy"
FAILURE_MODEL_FILE = "failure-model.mjb"


class PhysicsWarning(Model):
    """A kind of MuJoCo physics warning with its number of occurrences."""

    warning: str = Field(description="MuJoCo's name of the warning, `mjWARN_BADQVEL`.")
    count: int = Field(description="Number of occurrences.")
    text: str = Field(description="Message of MuJoCo.")
    joint: str | None = optional("Joint with non-finite numbers, if known.")
    body: str | None = optional("Body of that joint.")


class JointState(Model):
    """Position and velocity of one joint shortly before the simulation became unstable."""

    joint: str = Field(description="Name of the joint, or of its body if the joint has none.")
    body: str = Field(description="Body that the joint moves.")
    qpos: list[float | None] = Field(description="Positions in m and rad; null: not finite.")
    qvel: list[float | None] = Field(description="Velocities in m/s and rad/s; null: not finite.")
    qacc: list[float | None] = Field(description="Accelerations in m/s² and rad/s²; null: not finite.")


class StrongContact(Model):
    """One strong contact between two bodies shortly before the simulation became unstable."""

    first: str = Field(description="Name of one geom, or of its body.")
    second: str = Field(description="Name of the other geom, or of its body.")
    normal_force_N: float | None = Field(description="Normal force in newtons; null: not finite.")
    depth_m: float = Field(description="Penetration depth in metres; negative: apart.")
    position_m: tuple[float, float, float] = Field(description="Position of the contact, in metres.")


class FailureState(Model):
    """Joints and contacts of the simulation shortly before it became unstable, to find the cause."""

    schema_version: Literal[1] = Field(default=1, description="Format version of this document.")
    time_s: float = Field(description="Simulated time of the stored state, in seconds.")
    step: int = Field(description="Number of MuJoCo steps until then.")
    began_anew: bool = Field(description="Whether MuJoCo has reset the simulation since.")
    warnings: list[PhysicsWarning] = Field(description="Warnings of MuJoCo.")
    not_finite: dict[str, list[int]] = Field(
        description=(
            "Indices of `qpos`, `qvel` and `qacc` that are not finite now; empty if MuJoCo reset the simulation."
        )
    )
    joints: list[JointState] = Field(description="Joints of which MuJoCo warned, then the fastest ones; at most 10.")
    contacts: list[StrongContact] = Field(description="Contacts with the largest forces, at most 10.")
    control: dict[str, float] = Field(description="Last control signals, by actuator.")
    model_file: str = Field(
        default=FAILURE_MODEL_FILE, description="File name of the compiled model, for the same version of MuJoCo."
    )
    model_sha256: str = Field(description="Hash of the model, as in `provenance.json`.")
    state_file: str = Field(default=FAILURE_VECTOR_FILE, description="File name of the stored state, a NumPy vector.")
    state_kind: Literal["mjSTATE_INTEGRATION"] = Field(
        default="mjSTATE_INTEGRATION", description="Kind of state for `mj_setState`."
    )
    mujoco: str = Field(description="Version of MuJoCo.")
