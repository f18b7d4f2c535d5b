"""Behaviour of operations on simulation jobs and batches that their shapes do not say."""

from .behaviour import decided, differs

_JOB_REQUESTS = "CreateSimulationJob StartSimulationJobBatch"

SIMULATIONS = (
    differs(
        "Roles",
        f"{_JOB_REQUESTS} CreateWorldExportJob",
        known="Jobs had the rights of `iamRole`.",
        here="With a roles file, jobs read and write as the role; without one it is recorded only. Their processes are "
        "those of the job worker's user, without any of its variables that hold credentials. Batches do without it.",
    ),
    differs(
        "What runs",
        _JOB_REQUESTS,
        known="Two containers on one host, or two bundles with roslaunch.",
        here="Python factories that speak `dm_env`, on MuJoCo, in one process; programs of their own; containers.",
    ),
    differs(
        "One application is enough",
        _JOB_REQUESTS,
        known="A job had a robot application, a simulation application, or both.",
        here="The one that is missing is the built-in `scout` or `indoor-navigation`; a program may be alone.",
    ),
    differs(
        "Same seed, same run",
        _JOB_REQUESTS,
        known="There was no seed, and no video.",
        here="`seed` and `video`, or the tags `robomaker:seed` and `robomaker:video`.",
    ),
    differs(
        "Verdicts",
        _JOB_REQUESTS,
        known="A job that ran was `Completed`; whether the robot did well was for its own code to say.",
        here="`requirements`, or the launch variable `ROBOMAKER_REQUIREMENTS`, say what a run is judged by. The "
        "verdict is in `result.json` and in reports; the job is `Completed` all the same. See [Verdicts](verdicts.md).",
    ),
    differs(
        "Trials",
        _JOB_REQUESTS,
        known="Each episode was a job.",
        here="`trials`, or the launch variable `ROBOMAKER_TRIALS`, order many episodes in one job, with other seeds "
        "and other environment variables. See [Trials](trials.md).",
    ),
    differs(
        "Network",
        _JOB_REQUESTS,
        known="`vpcConfig` and `portForwardingConfig` gave a job an address and open ports.",
        here="`vpcConfig` is echoed. A job port answers on 127.0.0.1 of the machine that performs the job, with or "
        "without `vpcConfig`; `enableOnPublicIp` changes nothing.",
    ),
    differs(
        "Simulation units",
        _JOB_REQUESTS,
        known="A unit was a virtual processor and 2 GB of memory on a host of the job's own.",
        here="As many processors, or as many as there are, and 2 GiB of memory each, at most. `GPU_AND_CPU` needs a "
        "GPU where the job is performed, else it fails with `InvalidInput`.",
    ),
    differs(
        "Usual tools",
        _JOB_REQUESTS,
        known="`useDefaultTools` and `useDefaultApplications` started rviz, rqt, a terminal and rosbag record.",
        here="They are accepted and start nothing: every run is recorded anyway, and there is no screen.",
    ),
    differs(
        "Logs",
        _JOB_REQUESTS,
        known="CloudWatch, group `/aws/robomaker/SimulationJobs`.",
        here="Files in `logs/` of the job's outputs, one pair for the simulation and for each program, and Prefect's "
        "flow runs.",
    ),
    differs(
        "Commands, scripts and launch files",
        _JOB_REQUESTS,
        known="`launchConfig.command` replaced an image's command; bundles were started with roslaunch.",
        here="A command is a process in the application's folder, also without an image; a `.py` file is run as a "
        "script; `.launch` files need ROS on this machine. [What is started](simulation-jobs.md#what-is-started).",
    ),
    differs(
        "Container images",
        _JOB_REQUESTS,
        known="Every application was one, pulled from ECR.",
        here="docker or podman runs them where jobs are performed; without either the job fails with `InvalidInput`. "
        "They share the machine's network and processors, not its folders.",
    ),
    differs(
        "Jobs side by side",
        _JOB_REQUESTS,
        known="Each job had a host of its own.",
        here="Jobs share the machine and its network, so programs that listen need ports of their own. What roslaunch "
        "starts has a ROS 1 master of its job's own, and every job has a `ROS_DOMAIN_ID`, unless its variables set "
        "them. [ROS](simulation-jobs.md#ros).",
    ),
    differs(
        "Folders of a job",
        _JOB_REQUESTS,
        known="`/home/robomaker`, `/var/log` and `/opt/robomaker/datasources` of a container.",
        here="Programs without a container find them below `$ROBOMAKER_JOB_ROOT`, and `$HOME` is the first of them.",
    ),
    differs(
        "Tools",
        _JOB_REQUESTS,
        known="Their output went to CloudWatch, their windows to viewers.",
        here="Their output is `logs/<application>-<tool>.stdout.log` and `.stderr.log`; `streamUI` shows no windows. "
        "The same tool is started again after a pause that grows from half a second to thirty.",
    ),
    decided(
        "Paths of uploads",
        _JOB_REQUESTS,
        known="What follows the configuration's name was not documented.",
        here="The path below the glob's fixed folder: `/var/log/nav/**` keeps `/var/log/nav/a/b.log` as "
        "`<name>/a/b.log`.",
    ),
    decided(
        "Files that are being written",
        _JOB_REQUESTS,
        known="`UPLOAD_ROLLING_AUTO_REMOVE` uploads and deletes every five seconds; what happens to a file that is "
        "open was not documented.",
        here="It is left until it is closed, or the job ends. A file that still changes when all code has stopped "
        "fails the job with `UploadContentMismatchError`.",
    ),
    decided(
        "Default uploads",
        _JOB_REQUESTS,
        known="The guide adds them to own ones unless they are refused; the API names no default.",
        here="So does this; alone they are there for `useDefaultUploadConfigurations: true`. `ros-logs` is "
        "`/home/robomaker/.ros/log/**`, `ros-bags` `.ros/bag/**`, `gazebo-logs` `.gazebo/**`.",
    ),
    decided(
        "What responses say of members that were not given",
        f"{_JOB_REQUESTS} DescribeSimulationJob BatchDescribeSimulationJob",
        known="A response of 2023 has `loggingConfig {recordAllRosTopics: false}`, `applicationVersion: $LATEST`, "
        "`uploadConfigurations: []`, `useDefaultUploadConfigurations: false` and `useDefaultTools: false`; which of "
        "them its request gave is not known.",
        here="The same; `useDefaultUploadConfigurations` is `true` where own uploads bring the default ones along. "
        "The recording that every run of the simulation process makes is no ROS bag: it is made unless a request "
        "says `recordAllRosTopics: false`.",
    ),
    differs(
        "ROS services of jobs",
        _JOB_REQUESTS,
        known="Every job offered `/robomaker/job/cancel`, `add_tags`, `remove_tags` and `list_tags`, with the types "
        "of `robomaker_simulation_msgs`, in ROS 1 and ROS 2.",
        here="Jobs that roslaunch starts offer them where rospy is installed; the types need not be in the bundle. "
        "Jobs of `ros2 launch` offer them where the bundle has built the types.",
    ),
    differs(
        "Recording ROS topics",
        _JOB_REQUESTS,
        known="`recordAllRosTopics: true` recorded all topics of the job.",
        here="So it does for launch files, as `ros-topics` in the outputs, where `rosbag` or `ros2 bag` is installed; "
        "else `logs/ros-topics.log` says why not.",
    ),
    decided(
        "Where data is in a destination",
        _JOB_REQUESTS,
        known="The folder is replaced; whether keys keep their folders was not documented.",
        here="Files keep their whole key below it; an archive is unpacked into it. Everything is read-only.",
    ),
    decided(
        "Going on after a crash",
        _JOB_REQUESTS,
        known="`failureBehavior: Continue` left the host running; how the job ended then was not documented.",
        here="`RunningFailed` with its code and reason, while the rest goes on. At the duration limit it becomes "
        "`Failed`, when it is cancelled `Canceled`; a restart forgets the crash.",
    ),
    decided(
        "Images that break the rules",
        _JOB_REQUESTS,
        known="VOLUME and EXPOSE made a job fail with an unnamed 4XX code.",
        here="`InvalidInput`.",
    ),
    decided(
        "How long a job may take",
        _JOB_REQUESTS,
        known="14 days or 8, depending on the page; the console asked for 5 minutes at least.",
        here="1 second to 14 days of wall-clock time; reaching it is a normal end.",
    ),
    decided("Default of `failureBehavior`", _JOB_REQUESTS, known="Not documented.", here="`Fail`."),
    decided(
        "Empty locations and lists",
        _JOB_REQUESTS,
        known="A released client sends `outputLocation: {}`, `worldConfigs: []` and `tools: []`.",
        here="They mean nothing was given; outputs go to the configured bucket then.",
    ),
    decided(
        "No application at all",
        _JOB_REQUESTS,
        known="The model asks for neither application.",
        here="At least one has to be given.",
    ),
    decided(
        "What `$LATEST` runs",
        _JOB_REQUESTS,
        known="ETags of archives were read when an application was made or updated.",
        here="`$LATEST` takes the archive as it is when the job starts. A numbered version whose archive has changed "
        "fails the job with `RobotApplicationVersionMismatchedEtag` or `SimulationApplicationVersionMismatchedEtag`.",
    ),
    decided(
        "Data that changes",
        _JOB_REQUESTS,
        known="ETags are told; what a change means was not documented.",
        here="A job whose data has changed between request and start fails with `MismatchedEtag`.",
    ),
    decided(
        "When a job ends by itself",
        _JOB_REQUESTS,
        known="What a program that ends well means was not documented; jobs often cancelled themselves.",
        here="The end of the episode, `StopIteration`, or exit code 0 of an application that is a program ends the job "
        "as `Completed`. It can still cancel itself. `Terminated` is never used.",
    ),
    decided(
        "Name of a job", "DescribeSimulationJob", known="It has one, and no way to set it.", here="The id: `sim-…`."
    ),
    decided(
        "Address of a job",
        "DescribeSimulationJob",
        known="Clients index `networkInterface` of running jobs; without a network it was not documented.",
        here="Always there once a job runs; both addresses are 127.0.0.1.",
    ),
    decided(
        "`simulationTimeMillis`",
        "DescribeSimulationJob",
        known="Called simulated time, described as the job's duration.",
        here="Wall-clock milliseconds of the last run.",
    ),
    decided(
        "Id of a run",
        "DescribeSimulationJob",
        known="A folder named by date and time, according to one page.",
        here="The start in UTC, such as `2026-05-04T12-30-00-123456Z`; outputs are in `<prefix>/<job id>/<run id>/`.",
    ),
    decided(
        "Jobs that are not there",
        "BatchDescribeSimulationJob",
        known="Both `ResourceNotFoundException` and `unprocessedJobs` exist.",
        here="They come back in `unprocessedJobs`.",
    ),
    decided(
        "Length of pages",
        "ListSimulationJobs",
        known="`maxResults` up to 1000, but a list of at most 100.",
        here="1 to 1000 is accepted; no page has more than 100.",
    ),
    decided(
        "What can be restarted",
        "RestartSimulationJob",
        known="A running job; the error for others was not documented.",
        here="`Running` and `RunningFailed`, else `InvalidParameterException`. The earlier run's outputs are stored in "
        "a folder of their own; no limit is counted, `LimitExceededException` is never raised.",
    ),
    decided(
        "Defaults of a batch",
        "StartSimulationJobBatch",
        known="Not found.",
        here="14 days, and `ROBOMAKER_MAX_JOBS` jobs at once; both are told.",
    ),
    decided(
        "Order of a batch",
        "StartSimulationJobBatch",
        known="Not documented.",
        here="Requests become jobs in the order of the list.",
    ),
    decided(
        "Requests that cannot become jobs",
        "StartSimulationJobBatch DescribeSimulationJobBatch",
        known="Some fail at once, some were tried again until the timeout; which was not documented.",
        here="What is not found or wrong fails at once, with `ResourceNotFound` or `InvalidInput`; the others run.",
    ),
    decided(
        "Jobs that run at a batch's timeout",
        "StartSimulationJobBatch",
        known="Not documented.",
        here="They are cancelled, with `BatchTimedOut`; requests that wait fail with it. In a cancelled batch: "
        "`BatchCanceled`. A batch that is timing out cannot be cancelled.",
    ),
    decided("Filters of batches", "ListSimulationJobBatches", known="Not documented.", here="`status`."),
)
