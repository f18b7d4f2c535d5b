// Somebody's program: the JavaScript SDK against the service. Run by itself; prints what it was told.
//
// `node client.cjs PART`, with what to ask for as JSON on standard input; NODE_PATH says where the SDK is.
"use strict";

const assert = require("node:assert");
const fs = require("node:fs");
const sdk = require("@aws-sdk/client-robomaker");

const robomaker = new sdk.RoboMakerClient({});
const wanted = JSON.parse(fs.readFileSync(0, "utf8"));
const { name } = wanted;
const told = { sdk: require("@aws-sdk/client-robomaker/package.json").version };
const BUSY = ["Pending", "Preparing", "Running", "Restarting", "Terminating", "Canceling"];
const BATCH_BUSY = ["Pending", "InProgress", "Completing", "Canceling", "TimingOut"];

async function worlds() {
  const template = await tell("template", "CreateWorldTemplate", { name, templateBody: wanted.body, tags: { team: "maps" } });
  await tell("templateDescribed", "DescribeWorldTemplate", { template: template.arn });
  await tell("body", "GetWorldTemplateBody", { template: template.arn });
  const job = await tell("generation", "CreateWorldGenerationJob", {
    template: template.arn,
    worldCount: { floorplanCount: 1, interiorCountPerFloorplan: 2 },
    tags: { why: "nightly" },
    worldTags: { "made by": "clients" },
  });
  const generated = await finish("generated", "DescribeWorldGenerationJob", { job: job.arn });
  const oneJob = [{ name: "generationJobId", values: [shortId(job.arn)] }];
  await pages("worlds", "ListWorlds", "worldSummaries", { filters: oneJob });
  assert.equal(generated.status, "Completed", JSON.stringify(generated));
  const [first] = generated.finishedWorldsSummary.succeededWorlds;
  await tell("world", "DescribeWorld", { world: first });
  const made = await tell("export", "CreateWorldExportJob", {
    worlds: [first],
    outputLocation: { s3Bucket: wanted.bucket, s3Prefix: `exports/${name}` },
    iamRole: wanted.role,
  });
  await finish("exported", "DescribeWorldExportJob", { job: made.arn });
  await pages("exports", "ListWorldExportJobs", "worldExportJobSummaries", {});
  const ofTemplate = [{ name: "templateId", values: [shortId(template.arn)] }];
  await pages("generations", "ListWorldGenerationJobs", "worldGenerationJobSummaries", { filters: ofTemplate });
  await pages("templates", "ListWorldTemplates", "templateSummaries", {});
  await tell("worldsDeleted", "BatchDeleteWorlds", { worlds: [first, `${first}0`] });
  await pages("worldsLeft", "ListWorlds", "worldSummaries", { filters: oneJob });
  await tell("templateDeleted", "DeleteWorldTemplate", { template: template.arn });
  await refuse("templateGone", "DescribeWorldTemplate", { template: template.arn });
}

async function simulations() {
  const applications = await createApplications();
  const outputLocation = { s3Bucket: wanted.bucket, s3Prefix: `runs/${name}` };
  const { arn } = await tell("job", "CreateSimulationJob", jobRequest(applications, { tags: { run: "1" }, outputLocation }));
  await finish("jobEnded", "DescribeSimulationJob", { job: arn });
  await tell("tagged", "TagResource", { resourceArn: arn, tags: { verdict: "pass", "seen by": "me/you:+=", run: "2" } });
  await tell("tags", "ListTagsForResource", { resourceArn: arn });
  await tell("untagged", "UntagResource", { resourceArn: arn, tagKeys: ["seen by", "never there"] });
  await tell("tagsLeft", "ListTagsForResource", { resourceArn: arn });

  const good = jobRequest(applications);
  const wrong = structuredClone(good);
  wrong.robotApplications[0].application += "0";
  const batch = await tell("batch", "StartSimulationJobBatch", {
    createSimulationJobRequests: [good, wrong, good],
    batchPolicy: { maxConcurrency: 2, timeoutInSeconds: 300 },
    tags: { night: "monday" },
  });
  const ended = await finish("batchEnded", "DescribeSimulationJobBatch", { batch: batch.arn }, BATCH_BUSY);
  const jobs = ended.createdRequests.map((each) => each.arn);
  await tell("jobsDescribed", "BatchDescribeSimulationJob", { jobs: [...jobs, `${arn}0`] });
  const mine = [{ name: "simulationApplicationName", values: [name] }];
  await pages("jobs", "ListSimulationJobs", "simulationJobSummaries", { filters: mine });
  await pages("batches", "ListSimulationJobBatches", "simulationJobBatchSummaries", {});
}

async function cancels() {
  const long = jobRequest(await createApplications());
  long.simulationApplications[0].launchConfig.environmentVariables = { DURATION_S: "250" };
  const { arn } = await tell("job", "CreateSimulationJob", long);
  await until(async () => (await send("DescribeSimulationJob", { job: arn })).status === "Running");
  await tell("jobRunning", "DescribeSimulationJob", { job: arn });
  await tell("cancelled", "CancelSimulationJob", { job: arn });
  await finish("jobCancelled", "DescribeSimulationJob", { job: arn });
  const batch = await tell("batch", "StartSimulationJobBatch", { createSimulationJobRequests: [long, long] });
  await tell("batchCancelled", "CancelSimulationJobBatch", { batch: batch.arn });
  await finish("batchEnded", "DescribeSimulationJobBatch", { batch: batch.arn }, BATCH_BUSY);
}

async function errors() {
  const nobody = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-000000000000";
  await refuse("missing", "DescribeSimulationJob", { job: nobody });
  await refuse("missingTags", "TagResource", { resourceArn: nobody, tags: { a: "b" } });
  await refuse("invalidBody", "CreateWorldTemplate", { name, templateBody: '{"Buildings": 4}' });
  await refuse("tooLarge", "ListWorlds", { maxResults: 101 });
  await refuse("notInEnum", "ListRobotApplications", { versionQualifier: "SOME" });
  await refuse("notPattern", "ListWorlds", { nextToken: "no such page!" });
  await refuse("foreignToken", "ListWorlds", { nextToken: "bm93aGVyZQ==" });
  // Unlike boto3 this SDK checks nothing itself.
  await refuse("required", "DescribeWorld", {});
  await refuse("tooShort", "BatchDeleteWorlds", { worlds: [] });
  const applications = await createApplications();
  await refuse("exists", "CreateRobotApplication", application());
  const request = { ...jobRequest(applications), clientRequestToken: name };
  const first = await tell("first", "CreateSimulationJob", request);
  await tell("again", "CreateSimulationJob", request);
  await refuse("mismatch", "CreateSimulationJob", { ...request, maxJobDurationInSeconds: 61 });
  await tell("cancelled", "CancelSimulationJob", { job: first.arn });
  told.versions = [];
  for (let number = 0; number < 40; number += 1) {
    const { version } = await send("CreateRobotApplicationVersion", { application: applications.robot });
    told.versions.push(version);
  }
  await refuse("limit", "CreateRobotApplicationVersion", { application: applications.robot });
}

function application() {
  return { name, robotSoftwareSuite: { name: "General" }, sources: wanted.sources };
}

async function createApplications() {
  const robot = await tell("robotApplication", "CreateRobotApplication", application());
  const simulation = await tell("simulationApplication", "CreateSimulationApplication", {
    ...application(),
    simulationSoftwareSuite: { name: "SimulationRuntime" },
  });
  return { robot: robot.arn, simulation: simulation.arn };
}

function jobRequest(applications, members = {}) {
  const use = (application, launchFile) => [{ application, launchConfig: { packageName: wanted.package, launchFile } }];
  return {
    maxJobDurationInSeconds: 60,
    iamRole: wanted.role,
    robotApplications: use(applications.robot, "make_agent"),
    simulationApplications: use(applications.simulation, "make_environment"),
    ...members,
  };
}

async function send(operation, input) {
  const { $metadata, ...answer } = await robomaker.send(new sdk[`${operation}Command`](input));
  assert.equal($metadata.httpStatusCode, 200);
  assert.equal($metadata.attempts, 1);
  return answer;
}

async function tell(step, operation, input) {
  told[step] = await send(operation, input);
  return told[step];
}

async function finish(step, operation, input, busy = BUSY) {
  await until(async () => !busy.includes((await send(operation, input)).status));
  return tell(step, operation, input);
}

async function until(done) {
  const end = Date.now() + 120_000;
  while (!(await done())) {
    assert(Date.now() < end, "waited too long");
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
}

async function pages(step, operation, key, input) {
  const found = [];
  for await (const page of sdk[`paginate${operation}`]({ client: robomaker, pageSize: 1 }, input)) found.push(page[key]);
  told[step] = found.flat();
  told[`${step}Most`] = Math.max(...found.map((entries) => entries.length));
}

async function refuse(step, operation, input) {
  try {
    await send(operation, input);
    told[step] = "was not refused";
  } catch (error) {
    told[step] = {
      code: error.name,
      class: error instanceof (sdk[error.name] ?? Boolean) ? error.constructor.name : null,
      message: error.message,
      status: error.$metadata.httpStatusCode,
      requestId: error.$metadata.requestId,
      attempts: error.$metadata.attempts,
    };
  }
}

function shortId(arn) {
  return arn.slice(arn.lastIndexOf("/") + 1);
}

function asJson(key, value) {
  return this[key] instanceof Date ? { time: this[key].getTime() / 1000 } : value;
}

({ worlds, simulations, cancels, errors })[process.argv[2]]().then(() => console.log(JSON.stringify(told, asJson)));
