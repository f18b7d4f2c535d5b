"""Behaviour of operations on worlds that their shapes do not say."""

from .behaviour import decided, differs

_BODIES = "CreateWorldTemplate UpdateWorldTemplate"

WORLDS = (
    decided(
        "Names of templates",
        "CreateWorldTemplate",
        known="`ResourceAlreadyExistsException` is declared; whether for names was not documented.",
        here="Names may repeat, and may be left out.",
    ),
    decided(
        "Body or location",
        _BODIES,
        known="The model asks for neither.",
        here="Exactly one for a new template; for an update at most one.",
    ),
    decided(
        "Missing bodies",
        _BODIES,
        known="`ResourceNotFoundException` is declared.",
        here="A `templateLocation` where nothing is, or that cannot be read, is `InvalidParameterException`.",
    ),
    decided(
        "Wrapped bodies",
        _BODIES,
        known='Samples wrap the body as `{"name": …, "templateBody": {…}}`; the schema forbids it.',
        here="The wrapper is taken off.",
    ),
    decided(
        "Rules of bodies",
        _BODIES,
        known="The schema lets areas below zero, rooms of one name and unknown materials pass; the text does not.",
        here="The rules of the text hold: areas 10 to 300 m², names that differ and exist, known materials and models.",
    ),
    decided(
        "Defaults of bodies",
        _BODIES,
        known="Ceilings of 3.0 or 2.4 m and one or two rooms, depending on the page.",
        here="3.0 m, and one living room of 20 m².",
    ),
    differs(
        "World descriptions",
        "DescribeWorld",
        known="Worlds of version 2 had a `worldDescriptionBody`, whose form was never published.",
        here="Worlds of both versions have one, in a documented form, with seeds, content hash and proofs.",
    ),
    decided(
        "Body of a generation job",
        "GetWorldTemplateBody",
        known="What the parameter is for was not documented.",
        here="The body as it was when the job was made. Exactly one of `template` and `generationJob` has to be given.",
    ),
    decided(
        "Worlds of a deleted template",
        "DeleteWorldTemplate",
        known="Not documented.",
        here="Worlds and jobs stay, and say its ARN.",
    ),
    decided(
        "How many worlds",
        "CreateWorldGenerationJob",
        known="50 or 100, depending on the page; a job for more fails, or the call is refused.",
        here="The job fails with `AllWorldGenerationFailed` beyond `ROBOMAKER_MAX_WORLDS_PER_JOB` (50); counts below 1 "
        "or missing ones are refused.",
    ),
    differs(
        "Same seed, same worlds",
        "CreateWorldGenerationJob",
        known="There was no seed; no result could be had again.",
        here="`seed`, or the tag `robomaker:seed`, gives the same worlds again.",
    ),
    differs(
        "Form of worlds",
        "CreateWorldGenerationJob CreateWorldExportJob",
        known="Gazebo worlds (SDF) in two ROS packages.",
        here="MJCF for MuJoCo, a Nav2 map, a plan, a picture and a description; exports add SDF in the two packages.",
    ),
    decided(
        "What an export holds",
        "CreateWorldExportJob",
        known="Two packages for ROS, with worlds as SDF that share models; no such archive was kept.",
        here="The same layout, with each world's bundle, a GLB and an `index.json`; see `worlds-export.md`.",
    ),
    decided(
        "Summary of a running job",
        "DescribeWorldGenerationJob",
        known="Whether it grows was not documented.",
        here="It grows world by world; `finishedCount` counts worlds and failures.",
    ),
    decided(
        "What a cancelled job leaves",
        "CancelWorldGenerationJob CancelWorldExportJob",
        known="Not documented.",
        here="Worlds that are made stay; a cancelled export leaves no archive.",
    ),
    decided(
        "Cancelling what has ended",
        "CancelWorldGenerationJob CancelWorldExportJob CancelSimulationJob CancelSimulationJobBatch",
        known="Not documented.",
        here="It changes nothing and succeeds.",
    ),
    decided(
        "Cancelling a job that does not run",
        "CancelWorldGenerationJob CancelWorldExportJob CancelSimulationJob CancelSimulationJobBatch",
        known="Every job was performed by the service.",
        here="A job that waits ends at once; the job worker ends one that runs, soon.",
    ),
    decided(
        "Filters of worlds",
        "ListWorlds",
        known="`status` is documented, though worlds have none.",
        here="`status` is `Active` for all; `generationJobId` and `templateId` are known besides, as bare ids.",
    ),
    decided(
        "Filters of export jobs",
        "ListWorldExportJobs",
        known="`generationJobId` and `templateId` are documented, though export jobs have neither.",
        here="They are those of the worlds that are exported; `status` is known besides.",
    ),
    decided(
        "Worlds that are not there",
        "BatchDeleteWorlds",
        known="`ResourceNotFoundException` is not declared.",
        here="They come back in `unprocessedWorlds`. Jobs that already run in a deleted world go on.",
    ),
    decided(
        "Worlds of one export",
        "CreateWorldExportJob",
        known="One according to a page, up to 100 according to the model.",
        here="Up to 100, in one archive.",
    ),
    decided(
        "Bucket of an export",
        "CreateWorldExportJob",
        known="The model asks for a location, not for its parts.",
        here="`outputLocation.s3Bucket` has to be given.",
    ),
)
