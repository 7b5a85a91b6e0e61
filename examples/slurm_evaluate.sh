#!/bin/bash
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=32
#SBATCH --exclusive
#SBATCH --time=04:00:00
#SBATCH --requeue

export RAY_USAGE_STATS_ENABLED=0 RAY_AUTH_MODE=token
source .venv/bin/activate                       # on a file system that all machines share
head=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)
address=$(getent ahostsv4 "$head" | awk 'NR == 1 { print $1 }'):6379
ray get-auth-token --generate > /dev/null       # in the home folder, which all machines share
srun --nodes=1 --ntasks=1 push-recovery warmup  # compiles once, where the user's cache folder is shared
srun ray symmetric-run --address "$address" --min-nodes "$SLURM_JOB_NUM_NODES" --num-cpus "$SLURM_CPUS_PER_TASK" -- \
  push-recovery evaluate --suite hard --policies two-stage residual --ray "$address" --out runs/hard
