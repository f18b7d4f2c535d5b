"""The content of `failure-state.json`: the physics of a run that broke after MuJoCo had warned."""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional

FAILURE_STATE_FILE = "failure-state.json"
FAILURE_VECTOR_FILE = "failure-state.npy"
FAILURE_MODEL_FILE = "failure-model.mjb"


class PhysicsWarning(Model):
    """One kind of warning of MuJoCo."""

    warning: str = Field(description="MuJoCo's name of it, `mjWARN_BADQVEL`.")
    count: int = Field(description="How often it came.")
    text: str = Field(description="Message of MuJoCo.")
    joint: str | None = optional("Joint whose numbers were bad, where that is known.")
    body: str | None = optional("Body of that joint.")


class JointState(Model):
    """One joint, before it broke."""

    joint: str = Field(description="Its name, else its body's.")
    body: str = Field(description="Body that it moves.")
    qpos: list[float | None] = Field(description="Positions in m and rad; null: not finite.")
    qvel: list[float | None] = Field(description="Velocities in m/s and rad/s; null: not finite.")
    qacc: list[float | None] = Field(description="Accelerations in m/s² and rad/s²; null: not finite.")


class StrongContact(Model):
    """One contact, before it broke."""

    first: str = Field(description="One geom, else its body.")
    second: str = Field(description="The other.")
    normal_force_N: float | None = Field(description="Normal force; null: not finite.")
    depth_m: float = Field(description="How deep they are in each other; negative: apart.")
    position_m: tuple[float, float, float] = Field(description="Position of the contact, in metres.")


class FailureState(Model):
    """State of the physics shortly before a run broke."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    time_s: float = Field(description="Simulated time of the state that was kept.")
    step: int = Field(description="Steps of MuJoCo until then.")
    began_anew: bool = Field(description="Whether MuJoCo has put everything back to its beginning since.")
    warnings: list[PhysicsWarning] = Field(description="Warnings of MuJoCo.")
    not_finite: dict[str, list[int]] = Field(
        description="Places of `qpos`, `qvel` and `qacc` that are not finite now; empty once MuJoCo began anew."
    )
    joints: list[JointState] = Field(description="Joints that MuJoCo warned of, then the fastest; at most 10.")
    contacts: list[StrongContact] = Field(description="Those with the largest forces, at most 10.")
    control: dict[str, float] = Field(description="The last control signals, by actuator.")
    model_file: str = Field(default=FAILURE_MODEL_FILE, description="The compiled model, for the same MuJoCo.")
    model_sha256: str = Field(description="Digest of the model, as in `provenance.json`.")
    state_file: str = Field(default=FAILURE_VECTOR_FILE, description="The kept state as a vector of numpy.")
    state_kind: Literal["mjSTATE_INTEGRATION"] = Field(
        default="mjSTATE_INTEGRATION", description="Kind of state that `mj_setState` has to be told."
    )
    mujoco: str = Field(description="Version of MuJoCo.")
