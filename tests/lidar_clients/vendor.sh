#!/usr/bin/env bash
# Judges the emulated RPLIDAR by the vendor's own programs: its SDK for C++ and its ROS node in each
# mode of firmware 1.29, and its Arduino library on a simulated ATmega2560 in virtual time.
#
# usage: tests/lidar_clients/vendor.sh [SECONDS]    of scan a client, 6 if not given
#
# The sources are public (GitHub: Slamtec/rplidar_sdk, Slamtec/rplidar_ros,
# robopeak/rplidar_arduino) and no part of this repository. They are cloned, or taken from the Git
# repositories that RPLIDAR_SDK, RPLIDAR_ROS and RPLIDAR_ARDUINO name. Installs Debian's roscpp and
# what else is missing.
set -euo pipefail
cd "$(dirname "$0")"
target=$(realpath -m "${CARGO_TARGET_DIR:-../../target}")
out=$target/lidar-vendor
seconds=${1:-6}

missing=()
for package in g++ git libroscpp-dev librosconsole-dev libsensor-msgs-dev libstd-srvs-dev \
    python3-rospy python3-rosmaster python3-sensor-msgs gcc-avr avr-libc arduino-core-avr \
    libsimavr-dev libelf-dev; do
    dpkg -s "$package" >/dev/null 2>&1 || missing+=("$package")
done
if [[ ${#missing[@]} -gt 0 ]]; then
    as_root=()
    [[ $EUID -eq 0 ]] || as_root=(sudo)
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "${missing[@]}" >/dev/null
fi

# sources NAME OWNER/REPOSITORY COMMIT PATHS..: into $out/NAME, from the repository that the
# variable of this name tells, or cloned.
sources() {
    local name=$1 remote=$2 commit=$3 variable
    shift 3
    variable=${name^^}
    local repository=${!variable:-$out/$name.git}
    [[ -d $repository ]] ||
        git clone -q --bare "https://github.com/$remote" "$repository" || {
        echo "tests/lidar_clients: $remote cannot be cloned; $variable may name a copy:" \
            "nothing was judged" >&2
        exit 1
    }
    mkdir -p "$out/$name"
    git -C "$repository" archive "$commit" "$@" | tar x -C "$out/$name"
}
mkdir -p "$out"
sources rplidar_sdk Slamtec/rplidar_sdk master sdk
sources rplidar_ros Slamtec/rplidar_ros master src sdk
sources rplidar_arduino robopeak/rplidar_arduino master RPLidarDriver

# build FOLDER PROGRAM SOURCE LIBRARIES..: a program on the SDK in FOLDER/sdk.
build() {
    local folder=$1 program=$2 source=$3 objects=() file object
    shift 3
    [[ $program -nt $source ]] && return
    for file in "$source" "$folder"/sdk/src/*.cpp "$folder"/sdk/src/arch/linux/*.cpp \
        "$folder"/sdk/src/hal/*.cpp "$folder"/sdk/src/dataunpacker/{,unpacker/}*.cpp; do
        [[ -f $file ]] || continue
        object=$folder/$(basename "$file").o
        g++ -O1 -w -std=c++14 -I"$folder/sdk/include" -I"$folder/sdk/src" -c "$file" -o "$object"
        objects+=("$object")
    done
    g++ "${objects[@]}" "$@" -lpthread -o "$program"
}
build "$out/rplidar_sdk" "$out/vendor_sdk" vendor_sdk.cpp
build "$out/rplidar_ros" "$out/ros_node" "$out/rplidar_ros/src/node.cpp" \
    -lroscpp -lrosconsole -lrostime -lroscpp_serialization

export VENDOR_SDK=$out/vendor_sdk ROS_NODE=$out/ros_node
[[ -n ${HILRIG:-} ]] || {
    cargo build --locked --quiet --manifest-path ../../Cargo.toml --bin hilrig
    export HILRIG=$target/debug/hilrig
}
export PYTHONDONTWRITEBYTECODE=1
python3 judge.py "$seconds" vendor

cp arduino.cpp "$out/rplidar_arduino/RPLidarDriver/"
bash ../firmware/build.sh "$out/rplidar_arduino/RPLidarDriver/arduino.cpp" mega "$out/arduino.elf"
rm -rf "$out/arduino"
"$HILRIG" run arduino.toml --firmware "$out/arduino.elf" --board arduino-mega \
    --wire lidar=serial1 --out "$out/arduino" >"$out/arduino.log" ||
    { cat "$out/arduino.log" >&2 && exit 1; }
python3 arduino.py "$out/arduino/node-program.log"
