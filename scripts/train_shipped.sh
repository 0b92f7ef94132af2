#!/usr/bin/env bash
# Makes the network that the package ships: data, training, glsim/denoise/shipped/face.onnx. Resumes.
# Usage: scripts/train_shipped.sh FACEXMODEL [FOLDER]
#   FACEXMODEL: ICT-FaceKit's folder. FOLDER: for 2 GB of data and the run, default build/shipped.
# An hour on two cores. The results are in docs/model_card.md.
set -euo pipefail
cd "$(dirname "$0")/.."
model=${1:?say where ICT-FaceKit\'s FaceXModel is}
out=${2:-build/shipped}
glsim=${GLSIM:-.venv/bin/glsim}
sets=()

# generate NAME PEOPLE FRAMES OPTIONS...: a data set of embedded heads and one of ICT-FaceKit.
generate() {
    local name=$1 people=$2 frames=$3
    shift 3
    for source in procedural ict-facekit; do
        local root=()
        [ $source = procedural ] || root=(--root "$model")
        "$glsim" generate -q -o "$out/$name-$source" --source $source "${root[@]}" --subjects "$people" \
            --frames-per-subject "$frames" --crop 128 --depth-unit-mm 0.1 --split 0.94,0.06,0 \
            --set devices=4096 "$@"
        sets+=(--data "$out/$name-$source")
    done
}

# Any Kinect V2: parameters, distances, poses and variation are drawn; a third stands before a wall.
any=(--config train/data/randomised.toml)
wall=(--set 'scene.wall_mm={ uniform = [900, 2500] }')
generate kinect 400 16 "${any[@]}" --seed 101
generate wall 200 16 "${any[@]}" --seed 102 "${wall[@]}"
# Some pairs of every other sensor, and without noise (ideal), so that their frames are not harmed.
pose=(--set 'pose.yaw_deg={ uniform = [-60, 60] }' --set 'pose.pitch_deg={ uniform = [-25, 25] }'
    --set 'pose.distance_mm={ uniform = [550, 1400] }' --set variation.per=frame
    --set 'variation.shape_mm={ uniform = [0, 5] }' --set 'variation.albedo={ uniform = [0, 1.2] }')
for sensor in kinect-v2-fast kinect-v2-fankhauser kinect-v2-paper kinect-v1 azure-kinect led3d ideal; do
    generate "$sensor" 50 8 --sensor "$sensor" --seed 103 "${pose[@]}"
    generate "$sensor-wall" 25 8 --sensor "$sensor" --seed 104 "${pose[@]}" "${wall[@]}"
done

# In two parts, like the shipped weights: the second continues its cosine at step 6,000 of 10,000.
"$glsim" train face "${sets[@]}" --resume --steps 6000 -o "$out/run"
"$glsim" train face "${sets[@]}" --resume --steps 10000 -o "$out/run"
"$glsim" export "$out/run/best.pt" -o glsim/denoise/shipped/face.onnx
