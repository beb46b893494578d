#!/usr/bin/env bash
# A SLURM of this machine alone, as Debian's slurm-wlm and munge make one.
#
#   slurm.sh start FOLDER   start it; all its files go into FOLDER, which is to be new
#   slurm.sh stop FOLDER    end it
#
# Afterwards SLURM_CONF=FOLDER/slurm.conf makes sbatch, squeue and scancel talk to it.
# Needs the right to start daemons as root; the system's own SLURM is left alone.
set -euo pipefail
folder=$2 host=$(hostname -s)

pids() { cat "$folder"/munged.pid "$folder"/slurmctld.pid "$folder"/slurmd.pid 2>/dev/null || true; }

stop() {
    for pid in $(pids); do kill "$pid" 2>/dev/null || true; done
    for pid in $(pids); do
        timeout 10 tail --pid="$pid" -f /dev/null || kill -9 "$pid" 2>/dev/null || true
    done
}

if [ "$1" = stop ]; then
    stop
    exit
fi

mkdir -p "$folder"/{state,spool}
chmod 755 "$folder"
trap stop ERR
head -c 1024 /dev/urandom >"$folder/munge.key"
chmod 600 "$folder/munge.key"
munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
    --pid-file="$folder/munged.pid" --log-file="$folder/munged.log" \
    --seed-file="$folder/munged.seed" --num-threads=2

# two free ports
read -r control daemon < <(python3 -c '
import socket
ends = [socket.socket() for _ in range(2)]
for end in ends:
    end.bind(("", 0))
print(*(end.getsockname()[1] for end in ends))')
cat >"$folder/slurm.conf" <<CONF
ClusterName=alone
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$control
SlurmdPort=$daemon
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1
MpiDefault=none
ReturnToService=2
KillWait=5
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc --all) RealMemory=4096 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$folder/slurm.conf
slurmctld -f "$SLURM_CONF"
slurmd -f "$SLURM_CONF"
for _ in $(seq 100); do
    if [ "$(sinfo -h -o %t 2>/dev/null)" = idle ]; then
        trap - ERR
        exit
    fi
    sleep 0.1
done
cat "$folder"/*.log >&2
stop
exit 1
