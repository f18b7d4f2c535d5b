"""Provenance of a run's numbers: the content of `provenance.json` in its output folder."""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from .plan import RunPlan
from .programs import ApplicationRole

PROVENANCE_FILE = "provenance.json"


class MachineFacts(Model):
    """The part of a machine that can change the last bit of a number."""

    python: str = Field(description="Version of Python, `3.11.9`.")
    system: str = Field(description="Kernel and instruction set, `Linux x86_64`.")
    cpu_model: str = Field(description="The processor's name; two of the same features may have different names.")
    cpu_features: list[str] = Field(
        description="Those of avx2, avx512f, fma and their like that it has, and by which libraries choose their code."
    )
    libc: str = Field(description="C library, `glibc 2.36`: sines and powers are its.")
    versions: dict[str, str] = Field(description="Versions of mujoco, dm_control, numpy, scipy and this package.")


class ApplicationDigest(Model):
    """One application, as it was when the run ended."""

    role: ApplicationRole = Field(description="Robot or simulation application.")
    name: str = Field(description="Its name in the catalog.")
    attribute: str | None = optional("Dotted path of its factory; absent: it is a program.")
    content: Literal["bundle", "module"] = Field(
        description="Files that the digest is of: all of its bundle, or the Python files of its installed package."
    )
    sha256: str = Field(description="SHA-256 over names and bytes of those files, in hexadecimal.")


class JointPlace(Model):
    """Indices of a joint's numbers in the state."""

    name: str = Field(description="The joint's name, or its body's when it has none.")
    qpos: int = Field(description="Index of its first position.")
    qvel: int = Field(description="Index of its first velocity.")


class StateDigestSummary(Model):
    """A chain of hashes over the states of a run; `digest.bin` has every link of it."""

    algorithm: Literal["sha256"] = Field(default="sha256", description="Hash of each link over the one before.")
    state: Literal["mjSTATE_INTEGRATION"] = Field(
        default="mjSTATE_INTEGRATION", description="MuJoCo's name of what is hashed: all that integration starts from."
    )
    looks: int = Field(description="Number of links.")
    until_s: float = Field(description="Simulated time of the last one.")
    value: str = Field(description="The last link, in hexadecimal: equal for runs with the same states.")


class ActionsSummary(Model):
    """The actions of a robot application that is a program; `actions.bin` has each of them."""

    mode: Literal["lockstep", "free"] = Field(description="Whether the simulation waited for each action.")
    actions: int = Field(description="How many there are: one for each step, also where one was held.")
    size_bytes: int = Field(description="Size of the file.")
    sha256: str = Field(description="SHA-256 of the file, in hexadecimal.")


class Provenance(Model):
    """Provenance of a run: its plan, machine and digests, so that it can be repeated and compared."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    plan: RunPlan = Field(description="The run as carried out; its folders are those of the machine it ran on.")
    machine: MachineFacts = Field(description="The machine it ran on.")
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
        "SHA-256 of the compiled model, wherever its files lie; absent: no physics, or not yet begun."
    )
    positions: int = Field(default=0, description="How many positions the model has, `nq`.")
    joints: list[JointPlace] = Field(default=[], description="The model's joints.")
    digest: StateDigestSummary | None = optional(
        "Digest of its states; absent until it ends, and of runs without physics."
    )
    actions: ActionsSummary | None = optional(
        "Summary of `actions.bin`; absent until the run ends, and when the robot application is no program."
    )
    ended_by: str | None = optional("As in `result.json`; absent: it failed, goes on, or only had programs.")
    resumed_at_s: list[float] = Field(
        default=[], description="Simulated times of the checkpoints from which it was continued."
    )
