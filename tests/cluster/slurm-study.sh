#!/usr/bin/env bash
# slurm-study.sh ETALON: examples/study/slurm.sh for real, as a job array of three shards and the job
# that merges them, on a Slurm of one node that lives for this test on the loopback interface. The
# merged study must be that of one piece, byte for byte. Exit 77 with the reason where there is no Slurm.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
etalon=$1
skip() { echo "skipped: $*"; exit 77; }
for program in slurmctld slurmd sbatch squeue; do
    command -v "$program" >/dev/null || skip "$program is not installed (Debian: slurm-wlm)"
done
[ "$(id -u)" -eq 0 ] || skip "slurmd needs root to start jobs"

work=$(mktemp -d)
cleanup() {
    for daemon in slurmd slurmctld; do
        [ -s "$work/$daemon.pid" ] || continue
        pid=$(cat "$work/$daemon.pid")
        kill "$pid" && timeout 20 tail --pid="$pid" -f /dev/null
    done
    rm -rf "$work"
}
trap cleanup EXIT

mkdir "$work/state" "$work/spool"
port=$((20000 + RANDOM % 10000))
node=$(hostname -s)
cat >"$work/slurm.conf" <<CONF
ClusterName=etalon
SlurmctldHost=$node(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=root
AuthType=auth/none
CredType=cred/none
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
NodeName=$node NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=$node Default=YES State=UP
CONF
export SLURM_CONF=$work/slurm.conf
slurmctld -L "$work/slurmctld.log"
slurmd -N "$node" -L "$work/slurmd.log" -f "$SLURM_CONF"

cp "$here/../../examples/study/webcam.yml" "$work"
cat >"$work/study.yaml" <<'STUDY'
etalon: study/1
id: cluster
camera: webcam.yml
poses: {count: 40, z_mm: [300, 700], roll_deg: [-40, 40], pitch_deg: [-40, 40], yaw_deg: [-180, 180]}
detectors:
  - {detector: apriltag, marker: "apriltag:36h11:5@50mm"}
STUDY
# ------------------------------------------------------------------------- as the example's head says
job=$here/../../examples/study/slurm.sh
export ETALON=$etalon
cd "$work"
sbatch --array=1-3 --output="$work/job-%A-%a.log" "$job" "$work/study.yaml" "$work/out"
sbatch --dependency=singleton --output="$work/merge.log" "$job" "$work/study.yaml" "$work/out"
for _ in $(seq 600); do
    [ -n "$(squeue --noheader)" ] || break
    sleep 0.2    # polls the queue; what is waited for is its end
done
[ -f "$work/out/report.html" ] || {
    echo "the merged study has no report"
    squeue; tail -n 20 "$work"/*.log
    exit 1
}
"$etalon" study "$work/study.yaml" --out "$work/whole" >/dev/null
for file in "$work"/whole/*; do
    name=$(basename "$file")
    [ "$name" = times.json ] || cmp "$file" "$work/out/$name"
done
echo "3 shards on Slurm, merged: $(($(wc -l <"$work/out/results.csv") - 1)) poses, as in one piece"
