#!/bin/bash
# Evaluate a RoboTwin policy folder in the scenes of domino-data, with the arguments of RoboTwin's own eval.sh after the folder:
#   bash robotwin_eval/eval.sh RoboTwin/policy/ACT click_bell demo_clean CKPT_SETTING EXPERT_DATA_NUM SEED GPU_ID
set -e
folder=${1:?name the policy folder} task=${2:?name a task}
[ -z "${7-}" ] || export CUDA_VISIBLE_DEVICES=$7
exec python "$(dirname "$0")/script/eval_policy.py" --config "$folder/deploy_policy.yml" --overrides \
    --task_name "$task" --task_config "${3-demo_clean}" --ckpt_setting "${4-0}" --expert_data_num "${5-50}" --seed "${6-0}" \
    --policy_name "$(basename "$folder")"
