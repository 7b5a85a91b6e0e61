#!/bin/bash
#SBATCH --array=0-4
#SBATCH --cpus-per-task=8

source .venv/bin/activate
out=runs/seed-$SLURM_ARRAY_TASK_ID
if [ -d "$out/checkpoints" ]; then again="--resume $out"; else again="--seed $SLURM_ARRAY_TASK_ID --out $out"; fi
push-recovery train residual $again
