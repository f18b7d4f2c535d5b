"""What calls about simulation jobs and batches do that their shapes do not say."""

from .behaviour import decided, differs, not_yet

_ORDERS = "CreateSimulationJob StartSimulationJobBatch"

SIMULATIONS = (
    differs(
        "Roles",
        f"{_ORDERS} CreateWorldExportJob",
        known="Jobs had the rights of `iamRole`.",
        here="It is recorded, not assumed: jobs have the rights of whoever performs them. Batches do without it.",
    ),
    differs(
        "What runs",
        _ORDERS,
        known="Two containers on one host, or two bundles with roslaunch.",
        here="One process group; both applications are Python factories that speak `dm_env`, on MuJoCo.",
    ),
    differs(
        "One application is enough",
        _ORDERS,
        known="A job had a robot application, a simulation application, or both.",
        here="The one that is missing is the built-in `scout` or `indoor-navigation`.",
    ),
    differs(
        "Same seed, same run",
        _ORDERS,
        known="There was no seed, and no video.",
        here="`seed` and `video`, or the tags `robomaker:seed` and `robomaker:video`.",
    ),
    differs(
        "Network and machine",
        _ORDERS,
        known="`vpcConfig`, `portForwardingConfig`, `streamUI` and `compute` decided where a job ran.",
        here="They are echoed and without effect: applications share the machine, and its ports.",
    ),
    differs(
        "Usual tools and uploads",
        _ORDERS,
        known="`useDefaultTools`, `useDefaultUploadConfigurations` and `useDefaultApplications` started or kept some.",
        here="They are accepted and without effect; outputs and logs are always stored.",
    ),
    differs(
        "Logs",
        _ORDERS,
        known="CloudWatch, group `/aws/robomaker/SimulationJobs`.",
        here="`logs/stdout.log` and `logs/stderr.log` of the job's outputs, and Prefect's flow runs.",
    ),
    not_yet(
        "Commands",
        _ORDERS,
        known="`launchConfig.command` replaced an image's command.",
        here="Refused; `packageName` and `launchFile` say what is started.",
    ),
    not_yet(
        "Tools",
        _ORDERS,
        known="Up to ten programs ran beside an application.",
        here="Refused; applications may start them.",
    ),
    not_yet(
        "Own uploads",
        _ORDERS,
        known="`uploadConfigurations` said which files were kept, and when.",
        here="Refused; all files in `context.output_dir` are kept, at the end.",
    ),
    not_yet(
        "Where data is mounted",
        _ORDERS,
        known="`dataSources[].destination` was a folder in the container.",
        here="Refused; a source is in `context.data_dir`, below its name.",
    ),
    not_yet(
        "Going on after a crash",
        _ORDERS,
        known="`failureBehavior: Continue` left the host running, as `RunningFailed`.",
        here="Accepted, and treated as `Fail`.",
    ),
    decided(
        "How long a job may take",
        _ORDERS,
        known="14 days or 8, depending on the page; the console asked for 5 minutes at least.",
        here="1 second to 14 days of wall-clock time; reaching it is a normal end.",
    ),
    decided("Default of `failureBehavior`", _ORDERS, known="Not documented.", here="`Fail`."),
    decided(
        "Empty locations and lists",
        _ORDERS,
        known="A released client sends `outputLocation: {}`, `worldConfigs: []` and `tools: []`.",
        here="They mean nothing was given; outputs go to the configured bucket then.",
    ),
    decided(
        "No application at all",
        _ORDERS,
        known="The model asks for neither application.",
        here="At least one has to be given.",
    ),
    decided(
        "What `$LATEST` runs",
        _ORDERS,
        known="ETags of archives were read when an application was made or updated.",
        here="`$LATEST` takes the archive as it is when the job starts. A numbered version whose archive has changed "
        "fails the job with `RobotApplicationVersionMismatchedEtag` or `SimulationApplicationVersionMismatchedEtag`.",
    ),
    decided(
        "Data that changes",
        _ORDERS,
        known="ETags are told; what a change means was not documented.",
        here="A job whose data has changed between order and start fails with `MismatchedEtag`.",
    ),
    decided(
        "When a job ends by itself",
        _ORDERS,
        known="What a program that ends well means was not documented; jobs often cancelled themselves.",
        here="The end of the episode, or `StopIteration`, ends the job as `Completed`. `Terminated` is never used.",
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
