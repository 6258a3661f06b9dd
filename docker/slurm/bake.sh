#!/bin/sh
# Bakes a city in steps with job arrays: bake.sh WORK [sbatch options]. The job is in WORK already (`insula-server bake plan --inputs ...`).
set -eu
WORK=$1
shift
here=$(dirname "$(readlink -f "$0")")
limit=$(scontrol show config 2>/dev/null | sed -n 's/^MaxArraySize *= *//p')
limit=${limit:-1001}

# Submits the tasks of a stage, and waits for them. An array has fewer tasks than MaxArraySize, so a task runs several indexes.
run_stage() {
    stage=$1
    shift
    tasks=$(insula-server bake tasks "$stage" --work "$WORK")
    each=$(((tasks + limit - 2) / (limit - 1)))
    last=$(((tasks + each - 1) / each - 1))
    sbatch --wait --requeue --job-name="bake-$stage" --array="0-$last" \
        --export="ALL,STAGE=$stage,TASKS=$tasks,EACH=$each,WORK=$WORK" "$@" "$here/stage.sbatch"
}

for stage in scan plan shuffle region crown join-plan join-part join-finish; do
    # The plan of the join holds 160 bytes for each tile, and uses more than one core.
    if [ "$stage" = join-plan ]; then
        set -- --cpus-per-task="${JOIN_CPUS:-4}" --mem="${JOIN_MEMORY:-4G}" "$@"
    fi
    # What fails once, on a lost node say, is done in the second turn; what is done takes a moment.
    run_stage "$stage" "$@" || run_stage "$stage" "$@"
    if [ "$stage" = join-plan ]; then
        shift 2
    fi
done
insula-server bake status --work "$WORK"
