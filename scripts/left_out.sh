#!/usr/bin/env bash
# Trains three networks: on all cameras, without any Kinect V2, without cameras at random. Scores them on both. Resumes.
# Usage: scripts/left_out.sh [FOLDER] [RECORDING...]
#   FOLDER: that of scripts/train_shipped.sh with its data, default build/shipped. RECORDING: of a Kinect V2, for glsim eval-real.
# An hour of one core. The results are in docs/results/model_card.md.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-build/shipped}
shift || true
glsim=${GLSIM:-.venv/bin/glsim}

# train NAME SET...: 5,000 steps of 8 crops of 64 px; a frame of a room has many squares and counts three times.
train() {
    local name=$1 data=() set
    shift
    for set in "$@"; do
        data+=(--data "$set")
        case $set in */office-* | */living-room-*) data+=(--data "$set" --data "$set") ;; esac
    done
    "$glsim" train face "${data[@]}" --set data.target=expected --set data.crop=64 --set data.validation_frames=80 \
        --set training.validate_every=1250 --steps 5000 --resume -o "$out/left-out/$name"
}

shopt -s nullglob
kinects=("$out"/randomised-*/ "$out"/{office,living-room}-kinect-v2-people/)
random=("$out"/any_camera{,_320,_640,_1024}-{procedural,ict-facekit,people,wall-*}/ "$out"/{office,living-room}-any-depth-camera-people/)
train all "${kinects[@]%/}" "${random[@]%/}"
train no-kinect "${random[@]%/}"
train no-random "${kinects[@]%/}"
networks=("$out"/left-out/{all,no-kinect,no-random}/best.pt)
.venv/bin/python -m scripts.model_card "$out/left-out/scores" "${networks[@]}"
for recording in "$@"; do
    "$glsim" eval-real "$recording" -d "${networks[0]}" -d "${networks[1]}" -d "${networks[2]}" -o "$out/left-out/$(basename "$recording")"
done
