"""A specification of poles to balance, in the package of an example: one job for each text of its members."""

from .paths import REPOSITORY

PACKAGE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"
_APPLICATIONS = """\
version: 1
name: poles
steps:
  arena:
    operation: CreateSimulationApplication
    ifExists: reuse
    input:
      name: arena
      environment: {uri: "python://my_cartpole.arena"}
      robotSoftwareSuite: {name: General}
      simulationSoftwareSuite: {name: SimulationRuntime}
  agent:
    operation: CreateRobotApplication
    ifExists: reuse
    input: {name: agent, environment: {uri: "python://my_cartpole.agent"}, robotSoftwareSuite: {name: General}}
  balance:
    operation: StartSimulationJobBatch
    needs: [arena, agent]
    input:
      createSimulationJobRequests:
"""
_JOB = """\
        - maxJobDurationInSeconds: 60
          robotApplications: [{application: agent, launchConfig: {environmentVariables: {GAIN: "1"}}}]
          simulationApplications:
            - application: arena
              launchConfig: {environmentVariables: {TIME_LIMIT_S: "0.5"}}
"""


def poles(*jobs: str) -> str:
    """The specification; each job balances for half a second, and has these members besides."""
    return _APPLICATIONS + "".join(f"{_JOB}          {members}\n" for members in jobs)
