#!/bin/bash
# An array of Slurm, one task of which is killed and another one told to end while they render: both are run again. Started by
# run.sh.
set -euo pipefail
farm=$(dirname "$0")
for program in munged mungekey slurmctld slurmd sbatch; do
    if ! command -v $program > /dev/null; then
        echo "skipped: $program is missing: apt-get install -y slurm-wlm munge" >&2
        exit 69
    fi
done
[ "$(id -u)" = 0 ] || { echo "skipped: Slurm's daemons need root" >&2; exit 69; }

dir=$work/slurm
mkdir -p "$dir/state" "$dir/spool" "$dir/jobs"
host=$(hostname -s)
cat > "$dir/slurm.conf" <<CONF
ClusterName=curlsmoke
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=root
AuthType=auth/munge
# A job that is run again waits as long as a credential lives.
AuthInfo=socket=$dir/munge.socket,cred_expire=5
CredType=cred/munge
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
AccountingStorageType=accounting_storage/none
JobRequeue=1
ReturnToService=2
KillWait=10
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=60 State=UP
CONF
export SLURM_CONF=$dir/slurm.conf
stop() {
    # Only what was started here; each wrote its own number.
    for name in slurmd slurmctld munged; do
        if [ -s "$dir/$name.pid" ]; then kill "$(cat "$dir/$name.pid")" 2> /dev/null || true; fi
    done
    sleep 1
}
trap stop EXIT
mungekey --create --keyfile="$dir/munge.key"
chmod 400 "$dir/munge.key"
munged --force --socket="$dir/munge.socket" --key-file="$dir/munge.key" --pid-file="$dir/munged.pid" \
    --log-file="$dir/munged.log" --seed-file="$dir/munged.seed"
slurmctld -i
slurmd
for _ in $(seq 30); do sinfo -h -o %T 2> /dev/null | grep -q idle && break; sleep 1; done
sinfo

wait_for() { # SECONDS COMMAND...: until it succeeds.
    local left=$1; shift
    until "$@"; do
        left=$((left - 1))
        if [ $left -le 0 ]; then echo "gave up waiting for: $*" >&2; squeue; tail -n 50 "$dir"/jobs/*.log "$dir"/*.log; exit 1; fi
        sleep 1
    done
}
cd "$dir/jobs"
"$CURLSMOKE" farm slurm "$work/plume.yaml" --chunk 2 > plume.sbatch
# Checkpoints often, so that there is one to go on from whenever the task is killed.
sed -i 's/ --resume/ --resume --checkpoint-every 0.2/' plume.sbatch
grep '^#SBATCH' plume.sbatch
job=$(sbatch --parsable plume.sbatch)
renderer() { pgrep -f "^$CURLSMOKE render .*--frames $1 " | head -n 1; }
has_checkpoint() { [ -s "out/plume.000$1.checkpoint" ]; }
wait_for 120 has_checkpoint 1
echo "kill -9 of the task of frames 1-2"
kill -9 "$(renderer 1-2)"
wait_for 240 has_checkpoint 3
echo "TERM to the task of frames 3-4"
scancel --signal=TERM --batch "${job}_1"
is_over() { [ -z "$(squeue -h)" ]; }
wait_for 400 is_over
scontrol show job "$job" | grep -E 'ArrayTaskId|JobState|Restarts'
[ "$(scontrol show job "$job" | grep -c 'Restarts=1')" = 2 ]
[ "$(scontrol show job "$job" | grep -c 'JobState=COMPLETED')" = 2 ]
grep -h 'goes on from a checkpoint' plume.*.log
"$farm/same.sh" "$dir/jobs/out"

mkdir -p "$dir/baked" && cd "$dir/baked"
"$CURLSMOKE" farm slurm "$work/plume.yaml" --chunk 4 --bake > submit.sh
sh submit.sh
wait_for 400 is_over
for frame in 0001 0002 0003 0004; do
    "$CURLSMOKE" compare "out/plume.$frame.exr" "$work/local/out/plume.$frame.exr"
done
