# shellcheck shell=bash
# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
#
# Sets up this shell for the built workspace:  . ros2_ws/setup.bash
# With an installed ROS 2, source that first. With the wheels of make workspace, this is all.
_te_here=$(cd "$(dirname "${BASH_SOURCE[0]:-$0}")" && pwd)
if [ -f "$_te_here/install/.built" ]; then
    # Built on the wheels by ros2_ws/compile: another sourced ROS would be imported before them.
    [ -z "${AMENT_PREFIX_PATH:-}" ] || unset PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH
    . "$(dirname "$_te_here")/.venv/setup.bash"
    # colcon's script does not quote its interpreter, which fails in a folder with a space
    COLCON_PYTHON_EXECUTABLE=$(readlink -f "$VIRTUAL_ENV/bin/python")
fi
if [ -f "$_te_here/install/setup.bash" ]; then
    # colcon's scripts read unset variables
    case $- in *u*) _te_nounset=1 ;; *) _te_nounset= ;; esac
    set +u
    . "$_te_here/install/setup.bash"
    [ -z "$_te_nounset" ] || set -u
    unset _te_nounset COLCON_PYTHON_EXECUTABLE
else
    echo "The workspace is not built yet: run make workspace, or with an installed ROS python -m colcon build in $_te_here (docs/getting_started.md)" >&2
fi
export FASTRTPS_DEFAULT_PROFILES_FILE="${FASTRTPS_DEFAULT_PROFILES_FILE:-$_te_here/fastdds.xml}"
case ":$PATH:" in
    *":$_te_here/bin:"*) ;;
    *) export PATH="$PATH:$_te_here/bin" ;; # last, so that an installed ros2 comes first
esac
unset _te_here
