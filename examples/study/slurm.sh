#!/bin/sh
# A study on a cluster: one shard for each task of a job array, then the shards put together.
#
#   sbatch --array=1-8 examples/study/slurm.sh STUDY.yaml OUT
#   sbatch --dependency=singleton --job-name=etalon-study examples/study/slurm.sh STUDY.yaml OUT
#
# The second job waits for all tasks of the first and merges. OUT is on a disk that all nodes see;
# `etalon` is found in PATH or named by ETALON. A task that was killed goes on when it is queued again.
#SBATCH --job-name=etalon-study
#SBATCH --requeue
#SBATCH --open-mode=append
set -eu
study=$1 out=$2
etalon=${ETALON:-etalon}

if [ -n "${SLURM_ARRAY_TASK_ID-}" ]; then
    mkdir -p "$out.shards"
    exec "$etalon" study "$study" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" \
        --out "$out.shards/$SLURM_ARRAY_TASK_ID"
fi
exec "$etalon" study merge "$out.shards"/* --out "$out"
