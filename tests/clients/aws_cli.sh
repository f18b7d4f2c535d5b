#!/usr/bin/env bash
# Somebody's script: the AWS CLI against the service. Run by itself; writes what it was told to files of OUT.
#
# `aws_cli.sh PART`, in a folder with template.json; NAME, BUCKET, ROLE and SOURCE say what to ask for, ENDPOINT where.
set -euo pipefail

robomaker() { aws robomaker --endpoint-url "$ENDPOINT" "$@"; }
tell() { local step=$1; shift; robomaker "$@" > "$OUT/$step.json"; }
refuse() {
  local step=$1 code=0; shift
  robomaker "$@" > /dev/null 2> "$OUT/$step.error" || code=$?
  echo "$code" >> "$OUT/$step.error"
}
arn_of() { member_of "$1" arn; }
member_of() { sed -n "s/^    \"$2\": \"\(.*\)\".*/\1/p" "$OUT/$1.json"; }
tell_when() {
  local statuses=$1 step=$2; shift 2
  until tell "$step" "$@" && [[ " $statuses " == *" $(member_of "$step" status) "* ]]; do sleep 2; done
}
ended="Completed Failed Canceled PartialFailed TimedOut"

worlds() {
  tell template create-world-template --name "$NAME" --template-body file://template.json --tags team=maps
  local template job world
  template=$(arn_of template)
  tell templateDescribed describe-world-template --template "$template"
  tell body get-world-template-body --template "$template"
  tell generation create-world-generation-job --template "$template" --tags why=nightly \
    --world-count floorplanCount=1,interiorCountPerFloorplan=2 --world-tags '{"made by": "clients"}'
  job=$(arn_of generation)
  tell_when "$ended" generated describe-world-generation-job --job "$job"
  tell worlds list-worlds --page-size 1 --filters "name=generationJobId,values=${job##*/}" --query worldSummaries
  world=$(grep -o 'arn:aws:robomaker:[^"]*:world/[^"]*' "$OUT/generated.json" | head -n 1)
  tell world describe-world --world "$world"
  tell export create-world-export-job --worlds "$world" --iam-role "$ROLE" \
    --output-location "s3Bucket=$BUCKET,s3Prefix=exports/$NAME"
  tell_when "$ended" exported describe-world-export-job --job "$(arn_of export)"
  tell exports list-world-export-jobs --page-size 1 --query worldExportJobSummaries
  tell generations list-world-generation-jobs --page-size 1 --query worldGenerationJobSummaries \
    --filters "name=templateId,values=${template##*/}"
  tell templates list-world-templates --page-size 1 --query templateSummaries
  tell worldsDeleted batch-delete-worlds --worlds "$world" "${world}0"
  tell worldsLeft list-worlds --filters "name=generationJobId,values=${job##*/}" --query worldSummaries
  robomaker delete-world-template --template "$template"
  refuse templateGone describe-world-template --template "$template"
}

# With the waiters, which the service never had.
waiting() {
  tell template create-world-template --name "$NAME" --template-body file://template.json
  tell generation create-world-generation-job --template "$(arn_of template)" \
    --world-count floorplanCount=1,interiorCountPerFloorplan=1
  robomaker wait world-generation-job-completed --job "$(arn_of generation)"
  tell generated describe-world-generation-job --job "$(arn_of generation)"
}

# A request as `aws robomaker create-simulation-job --generate-cli-skeleton` begins it.
request() {
  cat << END
{
  "maxJobDurationInSeconds": 60,
  "iamRole": "$ROLE",
  "robotApplications": [
    {"application": "$1", "launchConfig": {"packageName": "sleeper", "launchFile": "make_agent"}}
  ],
  "simulationApplications": [
    {
      "application": "$2",
      "launchConfig": {
        "packageName": "sleeper",
        "launchFile": "make_environment",
        "environmentVariables": {"DURATION_S": "$3"}
      }
    }
  ]
}
END
}

simulations() {
  local source=(--name "$NAME" --robot-software-suite name=General --sources "$SOURCE") robot simulation
  tell robotApplication create-robot-application "${source[@]}"
  tell simulationApplication create-simulation-application "${source[@]}" \
    --simulation-software-suite name=SimulationRuntime
  refuse exists create-robot-application "${source[@]}"
  robot=$(arn_of robotApplication)
  simulation=$(arn_of simulationApplication)
  request "$robot" "$simulation" 0.1 > short.json
  job
  batch
}

job() {
  local arn
  tell job create-simulation-job --cli-input-json file://short.json --tags run=1 --client-request-token "$NAME" \
    --output-location "s3Bucket=$BUCKET,s3Prefix=runs/$NAME"
  arn=$(arn_of job)
  refuse mismatch create-simulation-job --cli-input-json file://short.json --client-request-token "$NAME"
  tell_when "$ended" jobEnded describe-simulation-job --job "$arn"
  robomaker tag-resource --resource-arn "$arn" --tags '{"verdict": "pass", "seen by": "me/you:+=", "run": "2"}'
  tell tags list-tags-for-resource --resource-arn "$arn"
  robomaker untag-resource --resource-arn "$arn" --tag-keys "seen by" "never there"
  tell tagsLeft list-tags-for-resource --resource-arn "$arn"
}

batch() {
  local jobs
  cat > batch.json << END
{
  "batchPolicy": {"maxConcurrency": 2, "timeoutInSeconds": 300},
  "createSimulationJobRequests": [$(cat short.json), $(request "${robot}0" "$simulation" 0.1), $(cat short.json)],
  "tags": {"night": "monday"}
}
END
  tell batch start-simulation-job-batch --cli-input-json file://batch.json
  tell_when "$ended" batchEnded describe-simulation-job-batch --batch "$(arn_of batch)"
  mapfile -t jobs < <(grep -o 'arn:aws:robomaker:[^"]*:simulation-job/[^"]*' "$OUT/batchEnded.json")
  tell jobsDescribed batch-describe-simulation-job --jobs "${jobs[@]}" "$(arn_of job)0"
  tell jobs list-simulation-jobs --page-size 1 --query simulationJobSummaries \
    --filters "name=simulationApplicationName,values=$NAME"
  tell batches list-simulation-job-batches --page-size 1 --query simulationJobBatchSummaries
}

errors() {
  refuse missing describe-simulation-job --job arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-000000000000
  refuse invalidBody create-world-template --name "$NAME" --template-body '{"Buildings": 4}'
  refuse tooLarge list-worlds --max-results 101
  tell page list-world-templates --max-items 1
}

"$1"
