#!/bin/sh
# Bakes a city in steps with Indexed Jobs: bake.sh WORK IMAGE [PARALLELISM]. The job is in WORK already (`insula-server bake plan --inputs ...`).
set -eu
work=$1
image=$2
most=${3:-64}
here=$(dirname "$(readlink -f "$0")")
for stage in scan plan shuffle region crown join-plan join-part join-finish; do
    tasks=$(insula-server bake tasks "$stage" --work "$work")
    cpus=1 memory=1200Mi
    # The plan of the join holds 160 bytes for each tile, and uses more than one core.
    if [ "$stage" = join-plan ]; then
        cpus=${JOIN_CPUS:-4} memory=${JOIN_MEMORY:-4Gi}
    fi
    kubectl delete job "bake-$stage" --ignore-not-found --wait
    sed -e "s|: .* # bake-STAGE|: bake-$stage|" -e "s|: .* # STAGE|: $stage|" -e "s|: .* # TASKS|: $tasks|" \
        -e "s|: .* # PARALLELISM|: $((tasks < most ? tasks : most))|" -e "s|: .* # IMAGE|: $image|" -e "s|: .* # WORK|: $work|" \
        -e "s|: .* # JOB|: \"${INSULA_JOB:-}\"|" \
        -e "s|: .* # CPUS|: \"$cpus\"|" -e "s|: .* # MEMORY|: $memory|" \
        "$here/stage.yaml" | kubectl apply -f -
    until kubectl wait --for=condition=Complete --timeout=60s "job/bake-$stage" 2>/dev/null; do
        if kubectl get "job/bake-$stage" -o jsonpath='{.status.conditions[?(@.type=="Failed")].status}' | grep -q True; then
            kubectl describe "job/bake-$stage"
            exit 1
        fi
    done
done
insula-server bake status --work "$work"
