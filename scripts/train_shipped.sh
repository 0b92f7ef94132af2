#!/usr/bin/env bash
# Makes the networks that the package ships: data, trainings, FOLDER/*.onnx; says whether they are the shipped ones. Resumes.
# Usage: scripts/train_shipped.sh FACEXMODEL [FOLDER]
#   FACEXMODEL: ICT-FaceKit's folder. FOLDER: for 10 GB of data and the runs, default build/shipped.
# About seven hours on two cores with bfloat16, one of them for the data; then three trainings that take a GPU seven minutes
# each and two cores a day. The results are in docs/results/model_card.md.
set -euo pipefail
cd "$(dirname "$0")/.."
model=${1:?say where ICT-FaceKit\'s FaceXModel is}
out=${2:-build/shipped}
glsim=${GLSIM:-.venv/bin/glsim}
stills=() more=() videos=()

# generate NAME SOURCE PEOPLE FRAMES OPTIONS...: makes a data set, by two workers.
generate() {
    local name=$1 source=$2 people=$3 frames=$4
    shift 4
    local root=() seed
    seed=$(printf %s "$name-$source" | cksum | cut -d ' ' -f 1) # of its own for each set
    [ "$source" != ict-facekit ] || root=(--root "$model")
    "$glsim" generate -q -o "$out/$name-$source" --source "$source" "${root[@]}" --subjects "$people" \
        --frames-per-subject "$frames" --set output.depth_unit_mm=0.1 --set split=0.94,0.06,0 --set devices=4096 \
        --set output.layers=clean,expected,noisy --seed "$seed" "$@"
}
# Frames of the same camera.
video=(--set redraw=sequence --set source.frames_per_sequence=8)

# choose CAMERA: sets config, the camera's settings, and wall, a wall behind the head.
choose() {
    config=(--config "train/data/$1.toml") wall=(--set 'scene.wall_mm={ uniform = [900, 2500] }')
    case $1 in
        randomised) config=(--preset randomised) ;;
        any_camera_1024) wall=(--set 'scene.wall_mm={ uniform = [2550, 4500] }') ;;
    esac
}

# Cameras that nobody built at four resolutions, and any Kinect V2; a third stands before a wall.
for camera in randomised any_camera_320 any_camera any_camera_640 any_camera_1024; do
    choose $camera
    for source in procedural ict-facekit people; do
        people=60 frames=12
        [ $camera != randomised ] || people=120
        [ $source != people ] || people=$((people / 3))
        for set in "$camera" "$camera-again" "$camera-third"; do # other people: the name is the seed
            generate "$set" $source $people $frames "${config[@]}"
            generate "$set-wall" $source $((people / 3)) 16 "${config[@]}" "${wall[@]}"
            made=(--data "$out/$set-$source" --data "$out/$set-wall-$source")
            if [ "$set" = "$camera-third" ]; then more+=("${made[@]}"); else stills+=("${made[@]}"); fi
        done
    done
done
# People in rooms: whole frames, of which each step sees a random square.
for camera in kinect-v2 any-depth-camera; do
    for room in office living-room; do
        for set in "$room-$camera" "$room-$camera-third"; do
            generate "$set" people 40 4 --preset $room --sensor $camera --set output.depth_unit_mm=0.2 # beyond 6.5 m
        done
        for _ in 1 2 3; do # a frame of a room has many squares
            stills+=(--data "$out/$room-$camera-people") more+=(--data "$out/$room-$camera-third-people")
        done
    done
done
# Clean frames stay as they are.
generate ideal procedural 40 8 --sensor ideal --set appearance.wear=never --set pose.pitch_deg=0 --set output.crop=128 --set 'pose.yaw_deg={ uniform = [-60, 60] }' \
    --set 'pose.distance_mm={ uniform = [520, 1450] }'
stills+=(--data "$out/ideal-procedural") more+=(--data "$out/ideal-procedural")

"$glsim" train face "${stills[@]}" --set data.target=expected --resume -o "$out/face-first"
"$glsim" train face "${more[@]}" --set data.target=expected --from "$out/face-first/best.pt" --set optimiser.lr=1.2e-3 \
    --steps 7100 --resume -o "$out/face"
# Form: relief and averaged frames, on heads of which a third is seen from behind, with hair. The mean of the weights before and
# after keeps what both can: bare heads and rooms of the one, hair and ribs of the other (docs/results/model_card.md).
forms=()
for camera in randomised any_camera_320 any_camera any_camera_640 any_camera_1024; do
    choose $camera
    for source in procedural ict-facekit people; do generate "form-$camera" $source 30 6 "${config[@]}"; forms+=(--data "$out/form-$camera-$source"); done
    generate "form-$camera-back" procedural 16 6 "${config[@]}" --set appearance.wear=always --set 'pose.yaw_deg={ uniform = [60, 300] }'
    for source in procedural people; do
        generate "form-$camera-wall" $source 15 6 "${config[@]}" "${wall[@]}"
        forms+=(--data "$out/form-$camera-wall-$source")
    done
    forms+=(--data "$out/form-$camera-back-procedural")
done
"$glsim" train face "${forms[@]}" --data "$out/office-kinect-v2-people" --from "$out/face/best.pt" --resume -o "$out/face-form" \
    --steps 4000 --set data.target=expected --set data.texture=0.4 --set data.averaged=0.2 --set data.crop=64 \
    --set optimiser.lr=1e-3 --set schedule.warmup_steps=60 --set training.ema_decay=0.998 --set training.precision=32-true
# mean OUT SHARE BEFORE AFTER: the weights of SHARE * BEFORE + (1 - SHARE) * AFTER.
mean() {
    "${glsim%glsim}python" - "$@" <<'PY'
import sys
import torch
out, share, *files = sys.argv[1:]
before, after = (torch.load(file, weights_only=True) for file in files)
for name, weights in after["model"].items():
    if weights.is_floating_point():
        after["model"][name] = float(share) * before["model"][name] + (1 - float(share)) * weights
torch.save(after, out)
PY
}
mean "$out/face-form/mean.pt" 0.5 "$out/face/best.pt" "$out/face-form/best.pt"
# Videos of moving heads.
for camera in randomised any_camera_320 any_camera any_camera_640 any_camera_1024; do
    choose $camera
    for source in procedural ict-facekit people; do
        people=30
        [ $source != people ] || people=15
        for set in "video-$camera" "video-$camera-fast"; do
            rate=30 # frames per second; with 8, a slow turn of the head is as fast as a quick one
            [ $set = "video-$camera" ] || rate=8
            made=("${video[@]}" --set source.frames_per_second=$rate "${config[@]}")
            generate "$set" $source $people 16 "${made[@]}"
            generate "$set-wall" $source $((people * 2 / 3)) 16 --set split=0.8,0.2,0 "${wall[@]}" "${made[@]}"
            videos+=(--data "$out/$set-$source" --data "$out/$set-wall-$source")
        done
    done
done

"$glsim" train face-video "${videos[@]}" --set data.target=expected --from "$out/face/best.pt" --resume -o "$out/face-video"

# Networks of one camera, from the weights of `face`.
# heads NAME PEOPLE NEAR FAR OPTIONS...: adds heads at NEAR to FAR mm, alone and before a wall, to $own.
heads() {
    local name=$1 number=$2 near=$3 far=$4 source people
    shift 4
    for source in procedural ict-facekit people; do
        people=$number
        [ $source != people ] || people=$((number * 2 / 5))
        local made=("$@" --set "pose.distance_mm={ uniform = [$near, $far] }")
        generate "$name" $source $people 12 "${made[@]}"
        generate "$name-wall" $source $((people / 2)) 12 "${made[@]}" \
            --set "scene.wall_mm={ uniform = [$((far - 200)), $((far + 1200))] }"
        own+=(--data "$out/$name-$source" --data "$out/$name-wall-$source")
    done
}
# rooms NAME PEOPLE OPTIONS...: adds people in rooms.
rooms() {
    local name=$1 people=$2 room
    shift 2
    for room in office living-room; do
        generate "$name-$room" people $people 4 --preset $room "$@" --set output.depth_unit_mm=0.2
        for _ in 1 2 3; do own+=(--data "$out/$name-$room-people"); done
    done
}
# train_own NETWORK FROM STEPS OPTIONS...: trains on $own, from the weights of another network.
train_own() {
    local network=$1 from=$2 steps=$3
    shift 3
    "$glsim" train face "${own[@]}" --set data.target=expected --from "$out/$from/best.pt" --set optimiser.lr=1.2e-3 \
        --steps "$steps" --resume -o "$out/$network" "$@"
    own=()
}
own=()
one=(--config train/data/any_camera.toml --sensor) # its poses and variation of shapes, another sensor
heads kinect-v2 50 550 1500 "${one[@]}" kinect-v2
rooms kinect-v2 50 --sensor kinect-v2
heads kinect-v2-sdk 40 550 1500 "${one[@]}" kinect-v2-sdk
rooms kinect-v2-sdk 40 --sensor kinect-v2-sdk
heads kinect-random 60 550 1500 --preset randomised
heads kinect-v2-far 15 1500 3000 "${one[@]}" kinect-v2
train_own face-kinect-v2-first face 5000
heads azure-kinect 80 520 1600 "${one[@]}" azure-kinect
heads azure-kinect-wfov 20 400 1100 "${one[@]}" azure-kinect-wfov
rooms azure-kinect 20 --sensor azure-kinect
train_own face-azure-kinect-first face 3500
# Other people, in larger batches.
wide=(--set training.batch=32 --set training.precision=32-true)
heads kinect-v2-more 60 550 1500 "${one[@]}" kinect-v2
rooms kinect-v2-more 24 --sensor kinect-v2
heads kinect-v2-sdk-more 60 550 1500 "${one[@]}" kinect-v2-sdk
rooms kinect-v2-sdk-more 24 --sensor kinect-v2-sdk
heads kinect-random-more 60 550 1500 --preset randomised
heads kinect-v2-far-more 12 1500 3000 "${one[@]}" kinect-v2
train_own face-kinect-v2 face-kinect-v2-first 3763 "${wide[@]}"
heads azure-kinect-more 90 520 1600 "${one[@]}" azure-kinect
heads azure-kinect-wfov-more 24 400 1100 "${one[@]}" azure-kinect-wfov
rooms azure-kinect-more 24 --sensor azure-kinect
train_own face-azure-kinect face-azure-kinect-first 3685 "${wide[@]}"
# Active stereo and structured light, from nothing.
heads realsense-d435 120 400 1300 "${one[@]}" realsense-d435
rooms realsense-d435 30 --sensor realsense-d435
heads realsense-d435-vga 15 400 1300 "${one[@]}" realsense-d435-vga
heads realsense-d455 30 400 1300 "${one[@]}" realsense-d455
heads realsense-d415 30 500 1800 "${one[@]}" realsense-d415
heads realsense-d405 30 250 900 "${one[@]}" realsense-d405
heads truedepth 90 250 900 "${one[@]}" truedepth
rooms truedepth 16 --sensor truedepth
"$glsim" train face-stereo "${own[@]}" --set data.target=expected --resume -o "$out/face-stereo"

# `face` knows the noise of a Kinect V2 by its mean with a network for that camera (docs/results/model_card.md).
mean "$out/face/mean.pt" 0.7 "$out/face-form/mean.pt" "$out/face-kinect-v2/best.pt"

# The shipped files are replaced by hand, once the model card has been made again.
for network in face face-video face-azure-kinect face-stereo; do
    made="$out/$network.onnx" shipped="glsim/denoise/shipped/$network.onnx"
    weights="$out/$network/best.pt"
    [ "$network" != face ] || weights="$out/face/mean.pt"
    "$glsim" export "$weights" -o "$made"
    if cmp -s "$made" "$shipped"; then
        echo "$made: the shipped network, byte for byte"
    else
        echo "$made: not the shipped network: sha256 $(sha256sum <"$made" | cut -c 1-16), shipped $(sha256sum <"$shipped" | cut -c 1-16)"
    fi
done
