#!/usr/bin/env bash
# slurm-study.sh ETALON: examples/study/slurm.sh for real, as job arrays of three shards and the jobs
# that merge them, on a Slurm of one node that lives for this test on the loopback interface. The merged
# study, operating characteristic and image set must be those of one piece, byte for byte. Exit 77 with the
# reason where there is no Slurm.
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
cp -r "$here/../../examples/demo" "$work"
sed -i 's/poses: 100/poses: 40/;s/repeats: 8/repeats: 2/;s/frames: 5/frames: 2/' "$work/demo/station.yaml"
printf 'rx,ry,rz,tx,ty,tz\n' >"$work/poses.csv"
for i in $(seq 40); do echo "0.$((i % 7)),-0.2,0.1,$i,-10,$((300 + 9 * i))"; done >>"$work/poses.csv"
# ------------------------------------------------------------------------- as the example's head says
job=$here/../../examples/study/slurm.sh
export ETALON=$etalon
cd "$work"
study=(study "$work/study.yaml")
oc=(oc "$work/demo/station.yaml" --runs 4 --error "focal length")
render=(render --camera "$work/webcam.yml" --marker apriltag:36h11:5@50mm --poses "$work/poses.csv")
submit() {  # NAME ARGUMENTS...
    local name=$1
    shift
    sbatch --job-name="$name" --array=1-3 --output="$work/$name-%a.log" "$job" "$work/$name" "$@"
    sbatch --job-name="$name" --dependency=singleton --output="$work/$name-merge.log" "$job" "$work/$name" "$@"
}
submit study "${study[@]}"
submit oc "${oc[@]}"
submit render "${render[@]}"
for _ in $(seq 600); do
    [ -n "$(squeue --noheader)" ] || break
    sleep 0.2    # polls the queue; what is waited for is its end
done
[ -f "$work/study/report.html" ] || {
    echo "the merged study has no report"
    squeue; tail -n 20 "$work"/*.log
    exit 1
}
"$etalon" "${study[@]}" --out "$work/whole-study" >/dev/null
"$etalon" "${oc[@]}" --out "$work/whole-oc" >/dev/null
"$etalon" "${render[@]}" --out "$work/whole-render" >/dev/null
for name in study oc render; do
    for file in "$work/whole-$name"/*; do
        [ "$(basename "$file")" = times.json ] || cmp "$file" "$work/$name/$(basename "$file")"
    done
done
echo "3 shards each on Slurm, merged: $(($(wc -l <"$work/study/results.csv") - 1)) poses of a study," \
    "4 runs, $(grep -c "\"file\"" "$work/render/images.jsonl") images, as in one piece"
