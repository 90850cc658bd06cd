#!/bin/sh
# A study, an operating characteristic or an image set on a cluster: one shard for each task of a job
# array, then the shards put together.
#
#   sbatch --array=1-8 examples/study/slurm.sh OUT study study.yaml
#   sbatch --dependency=singleton examples/study/slurm.sh OUT study study.yaml
#
# and in place of `study study.yaml`
#
#   oc station.yaml --runs 100000
#   render --camera camera.yml --marker apriltag:36h11:5@50mm --poses poses.csv
#
# The second job waits for all tasks of the first and merges. OUT is on a disk that all nodes see;
# `etalon` is found in PATH or named by ETALON. A task that was killed goes on when it is queued again.
#SBATCH --job-name=etalon-shards
#SBATCH --requeue
#SBATCH --open-mode=append
set -eu
out=$1
shift
etalon=${ETALON:-etalon}

if [ -n "${SLURM_ARRAY_TASK_ID-}" ]; then
    mkdir -p "$out.shards"
    exec "$etalon" "$@" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" \
        --out "$out.shards/$SLURM_ARRAY_TASK_ID"
fi
exec "$etalon" "$1" merge "$out.shards"/* --out "$out"
