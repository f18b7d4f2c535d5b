"""Behaviour of operations on applications, fleets, robots and tags that their shapes do not say."""

from .behaviour import decided, differs

_CREATE = "CreateRobotApplication CreateSimulationApplication"
_VERSION = "CreateRobotApplicationVersion CreateSimulationApplicationVersion"
_DESCRIBE = "DescribeRobotApplication DescribeSimulationApplication"
_LIST = "ListRobotApplications ListSimulationApplications"
_UPDATE = "UpdateRobotApplication UpdateSimulationApplication"
_DELETE = "DeleteRobotApplication DeleteSimulationApplication"
_DEPLOY = "CreateDeploymentJob SyncDeploymentJob"

APPLICATIONS = (
    differs(
        "What archives hold",
        f"{_CREATE} {_UPDATE}",
        known="`sources` were colcon bundles, started with roslaunch.",
        here="`sources` are .tar, .tar.gz or .zip archives of Python packages, programs, or ROS packages, launched by "
        "the ROS that is installed where jobs run; suites are recorded only. Bundles of `colcon bundle`, versions "
        "1 and 2, are unpacked and launched by the ROS in them, or else by the installed one; one whose ROS needs what "
        "the machine lacks is refused by that name.",
    ),
    differs(
        "Installed packages",
        f"{_CREATE} {_UPDATE}",
        known="`environment.uri` was a container image.",
        here="`python://package.module` names a package that is installed where jobs run.",
    ),
    differs(
        "Built-in applications",
        f"{_LIST} {_UPDATE} {_DELETE}",
        known="An account began empty.",
        here="So do its lists; `scout`, `walker` and `indoor-navigation` are there where a filter asks for their name, "
        "and wherever an application is named. They can be neither updated nor deleted.",
    ),
    differs(
        "Container images",
        f"{_CREATE} {_UPDATE}",
        known="Images in ECR, whose digest was read when a version was made.",
        here="Images that docker or podman finds. A version keeps the digest that its URI or `imageDigest` says, and a "
        "job whose image has another one fails; without either the version runs whatever the tag names.",
    ),
    decided(
        "Both or neither of sources and environment",
        f"{_CREATE} {_UPDATE}",
        known="The model asks for neither.",
        here="Exactly one has to be given, else `InvalidParameterException`.",
    ),
    decided(
        "Client tokens of applications",
        f"{_CREATE} {_VERSION}",
        known="`IdempotentParameterMismatchException` is declared, though there is no token.",
        here="It is never raised; a taken name is `ResourceAlreadyExistsException`.",
    ),
    decided(
        "Another revision than the caller thinks",
        f"{_VERSION} {_UPDATE}",
        known="The error for a `currentRevisionId` that is not the current one was not documented.",
        here="`InvalidParameterException`, with the current one; of simultaneous updates of one revision one wins.",
    ),
    decided(
        "Revision of a version",
        _VERSION,
        known="Whether making a version changes the revision was not documented.",
        here="It does not: the version has the revision that it was made of.",
    ),
    decided(
        "Expected content",
        _VERSION,
        known="The answer to `s3Etags` or an `imageDigest` that differ was not documented.",
        here="`InvalidParameterException`. `s3Etags` may be in any order, and in quotes. A digest is read from an "
        "image's name (`@sha256:…`), else the caller's word is taken.",
    ),
    decided(
        "A version of nothing",
        _VERSION,
        known="`ResourceNotFoundException` is not declared.",
        here="An application that does not exist is `InvalidParameterException`.",
    ),
    decided(
        "Version numbers",
        f"{_VERSION} {_DELETE}",
        known="Numbers count from 1, at most 40 versions.",
        here="At most 40 at the same time: deleting one makes room, but its number never comes back.",
    ),
    decided(
        "Entries of lists",
        _LIST,
        known="`versionQualifier` takes `ALL` only; what it is without was not documented.",
        here="Without: one entry per application, `$LATEST`. With `ALL`: all versions besides.",
    ),
    decided(
        "Deleting what is not there",
        _DELETE,
        known="`ResourceNotFoundException` is not declared.",
        here="It succeeds; an ARN of something else is `InvalidParameterException`.",
    ),
    decided(
        "Deleting `$LATEST`",
        _DELETE,
        known="Without a version the application goes with all of them; of `$LATEST` nothing was said.",
        here="`$LATEST` alone cannot be deleted.",
    ),
    decided(
        "Deleting an application in use",
        _DELETE,
        known="Not documented.",
        here="It is allowed: jobs that run go on, jobs that still wait fail with `ResourceNotFound`.",
    ),
    decided(
        "Digest of an image",
        _DESCRIBE,
        known="Descriptions of container applications have an `imageDigest`.",
        here="It is there when the image's name or the caller of the version gave one; nothing is looked up.",
    ),
)

FLEETS = (
    differs(
        "Deployments",
        f"{_DEPLOY} DescribeDeploymentJob",
        known="Greengrass brought an application to the robots of a fleet, and started it, until 2022.",
        here="Robots run our agent, which carries `launchConfig` out, or an updater that polls `robomaker serve`, such "
        "as SWUpdate, see [Fleets](fleets.md). An updater installs the application's archive; what it starts is its "
        "own affair. A `downloadConditionFile` is asked by agents; other robots of the fleet fail, and a fleet "
        "without an agent is refused.",
    ),
    differs(
        "Control over a deployment",
        "CreateDeploymentJob DescribeDeploymentJob",
        known="Percentages, a threshold and a time-out; a deployment could be cancelled.",
        here="Besides: canaries, approval, maintenance windows, pause and rollback, see "
        "[Control a rollout](fleets.md#control-a-rollout).",
    ),
    differs(
        "Operations that had ended",
        "CreateFleet CreateRobot RegisterRobot CreateDeploymentJob SyncDeploymentJob",
        known="From May 2022 on all fifteen calls were refused, with `ThrottlingException`.",
        here="They answer; `ROBOMAKER_REFUSE_DEPRECATED=1` refuses them, with `InvalidParameterException`.",
    ),
    decided(
        "Names of fleets",
        "CreateFleet",
        known="`ResourceAlreadyExistsException` is declared for robots, not for fleets.",
        here="Names of fleets may repeat; names of robots may not, until the robot is deleted.",
    ),
    decided(
        "Deleting a fleet",
        "DeleteFleet",
        known="Its robots are deregistered; of a deployment under way nothing was said.",
        here="The deployment fails with `DeploymentFleetDoesNotExist`. Deleting what is not there succeeds.",
    ),
    decided(
        "Deleting a robot",
        "DeleteRobot",
        known="`ResourceNotFoundException` is not declared.",
        here="Deleting what is not there succeeds.",
    ),
    decided(
        "Registering twice",
        "RegisterRobot DeregisterRobot",
        known="A robot is in at most one fleet; the answers were not documented.",
        here="Registering with the same fleet again changes nothing, nor does deregistering what is in no fleet; "
        "another fleet is `InvalidParameterException`.",
    ),
    differs(
        "Greengrass",
        "CreateRobot",
        known="`greengrassGroupId` named a group of AWS IoT Greengrass.",
        here="It is recorded and not looked at.",
    ),
    decided(
        "Missing things in lists",
        "ListFleets ListRobots ListDeploymentJobs",
        known="`ResourceNotFoundException` is declared.",
        here="It is never raised; a filter that nothing matches gives an empty list.",
    ),
    decided(
        "`$LATEST` in deployments",
        "CreateDeploymentJob",
        known="One sample of the guide uses it, the pattern has digits only.",
        here="It is refused: a deployment needs a numbered version.",
    ),
    decided(
        "What cannot be deployed",
        _DEPLOY,
        known="There are failure codes for it; whether the call was refused was not documented.",
        here="A fleet without robots, and an application for none of their architectures, are refused at once.",
    ),
    decided(
        "Defaults of a deployment",
        "CreateDeploymentJob",
        known="Five hours per robot; the two percentages' defaults were not found.",
        here="20 % of the robots at the same time, and 20 % failures end it; descriptions tell all three.",
    ),
    decided(
        "Two deployments of a fleet",
        _DEPLOY,
        known="`ConcurrentDeploymentException`, whose own description speaks of thresholds.",
        here="It is raised while the fleet's last deployment has not ended.",
    ),
    decided(
        "What is synchronised",
        "SyncDeploymentJob",
        known="The latest deployment is repeated for robots that lack it.",
        here="The latest is requested once more, however it ended, for the robots whose status is not `InSync`; "
        "without one: refused.",
    ),
    decided(
        "Cancelling a deployment that has ended",
        "CancelDeploymentJob",
        known="Not documented.",
        here="It changes nothing and succeeds.",
    ),
)

TAGS = (
    decided(
        "Length of tags",
        "TagResource",
        known="The guide says 127 and 255 characters and lists `@`; the model says 128 and 256, without it.",
        here="The model's.",
    ),
    decided(
        "Reserved tags",
        "TagResource",
        known="`aws:` is reserved.",
        here="In any mix of capitals; `InvalidParameterException`.",
    ),
    decided("Tags that are not there", "UntagResource", known="Not documented.", here="They are ignored."),
    decided(
        "Tags of versions",
        "ListTagsForResource TagResource UntagResource",
        known="A version's ARN is that of its application.",
        here="All versions have the application's tags.",
    ),
)
