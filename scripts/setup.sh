#!/usr/bin/env bash
# Makes a working environment in .venv on a bare Debian or Ubuntu box: uv, Python 3.12, the locked packages.
# setup.sh core: what builds, exports and shows datasets; setup.sh all: every extra and what the tests need, with a Vulkan driver for older looks.
# Idempotent; returns at once when .venv was made from the present lock. `core` leaves an environment that holds all as large as it is. Nothing outside the repository is touched except
# system packages (apt) that are missing, and uv's own cache.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly TOOLS=$PWD/.tools STAMP=.venv/.domino-setup
say() { printf 'setup: %s\n' "$*" >&2; }
die() { say "$*"; exit 2; }

case "${1:-all}" in core | all) ;; *) die "usage: scripts/setup.sh [core|all]" ;; esac
PROFILE=${1:-all}
# an environment that holds all stays so; stamps of before there were profiles are of such ones
[ ! -f "$STAMP" ] || grep -q '^core ' "$STAMP" || PROFILE=all

key() { echo "$PROFILE $(sha256sum uv.lock pyproject.toml scripts/setup.sh | sha256sum | cut -d' ' -f1)"; }
ready() { [ -f "$STAMP" ] && [ "$(cat "$STAMP")" = "$(key)" ] && .venv/bin/python -c '' 2>/dev/null; }

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"
    elif ! command -v sudo >/dev/null; then return 1
    elif [ -t 0 ]; then sudo "$@"
    else sudo -n "$@"
    fi
}
apt_install() { as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@" >&2; }

# ---- uv

find_uv() {
    local candidate
    for candidate in "$TOOLS/bin/uv" $(type -aP uv || true) ~/.local/bin/uv ~/.cargo/bin/uv; do
        # a shim may stand on PATH and still refuse to run
        if "$candidate" --version >/dev/null 2>&1; then echo "$candidate"; return; fi
    done
    return 1
}

uv_by_pip() {
    local python
    for python in $(type -aP python3 || true); do
        "$python" -m pip --version >/dev/null 2>&1 || continue
        # --target keeps out of the system's packages, so that it is allowed on an "externally managed" Python as well
        "$python" -m pip install --quiet --upgrade --target "$TOOLS" uv >&2 && find_uv && return
    done
    return 1
}

uv_by_pipx() { command -v pipx >/dev/null && pipx install uv >&2 && find_uv; }
uv_by_apt() { command -v apt-get >/dev/null && as_root apt-get update >&2 && apt_install python3-pip ca-certificates && uv_by_pip; }
uv_by_installer() {
    local fetch
    if command -v curl >/dev/null; then fetch='curl -LsSf'; elif command -v wget >/dev/null; then fetch='wget -qO-'; else return 1; fi
    $fetch https://astral.sh/uv/install.sh | UV_INSTALL_DIR="$TOOLS/bin" UV_NO_MODIFY_PATH=1 sh >&2 && find_uv
}

# ---- Python 3.12

works() { "$1" -c 'import sys, ssl, ctypes, lzma, bz2; sys.exit(sys.version_info[:2] != (3, 12))' >/dev/null 2>&1; }

find_python() {
    local candidate root
    for candidate in $(type -aP python3.12 || true) $(type -aP python3 || true); do
        if works "$candidate"; then echo "$candidate"; return; fi
    done
    for root in ${PYENV_ROOT:+"$PYENV_ROOT"} ~/.pyenv; do
        for candidate in "$root"/versions/3.12*/bin/python3.12; do
            if works "$candidate"; then echo "$candidate"; return; fi
        done
    done
    candidate=$("$UV" python find --no-project 3.12 2>/dev/null) && works "$candidate" && echo "$candidate"
}

python_by_uv() { "$UV" python install 3.12 >&2 && find_python; }
python_by_apt() { apt-cache show python3.12 >/dev/null 2>&1 && apt_install python3.12 && find_python; }

# ---- system libraries, and Vulkan, which only older looks and --render rt need

# bytecode is written here once, so that later processes start quickly where PYTHONDONTWRITEBYTECODE is set
loads() {
    local modules='cv2, sapien, numba, scipy.optimize, scipy.spatial, h5py, pyarrow.parquet, yaml, typer, pydantic, trimesh, tqdm'
    [ "$PROFILE" = core ] || modules+=', torch, ray, pytest, hypothesis, pinocchio, coal, toppra'
    env -u PYTHONDONTWRITEBYTECODE .venv/bin/python -W ignore -c "import $modules"
}
renders() { .venv/bin/python -c 'import sapien; sapien.render.RenderSystem()' >/dev/null 2>&1; }

mesa_suite() {  # the first suite known to apt that holds Mesa >= 25
    apt-cache madison mesa-vulkan-drivers |
        awk -F'|' '{ split($3, source, " "); split(source[2], suite, "/"); if ($2 + 0 >= 25) { print suite[1]; exit } }'
}

backports_line() {  # a source of RELEASE-backports, from the server of the machine's own source of that release and by its keys
    local release=$1 uri file keys
    read -r uri file < <(apt-get indextargets --format '$(RELEASE) $(COMPONENT) $(REPO_URI) $(SOURCESENTRY)' 'Created-By: Packages' |
        awk -v release="$release" '$1 == release && $2 == "main" { print $3, $4; exit }') && [ -n "$uri" ] || return 1
    keys=$(grep -ioE 'signed-by[:=] *"?/[^], "]+' "${file%:*}" 2>/dev/null | head -n 1 | grep -oE '/.*') || true
    echo "deb ${keys:+[signed-by=$keys] }$uri $release-backports main"
}

install_mesa() {
    local suite codename line
    command -v apt-get >/dev/null || { say "this is not a Debian or Ubuntu: install Mesa >= 25 (lavapipe) by hand"; return 1; }
    as_root apt-get update >&2 || { say "apt-get update failed or needs root: install Mesa >= 25 (mesa-vulkan-drivers) by hand"; return 1; }
    codename=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
    suite=$(mesa_suite)
    if [ -z "$suite" ] && [ "$(. /etc/os-release && echo "$ID")" = debian ] && line=$(backports_line "$codename"); then
        say "adding a source for Mesa >= 25: $line"
        echo "$line" | as_root tee "/etc/apt/sources.list.d/$codename-backports.list" >/dev/null
        if ! as_root apt-get update >&2; then
            say "$codename-backports is not to be had there: install Mesa >= 25 (mesa-vulkan-drivers) by hand"
            as_root rm -f "/etc/apt/sources.list.d/$codename-backports.list"
            return 1
        fi
        suite=$(mesa_suite)
    fi
    if [ -z "$suite" ]; then
        say "apt offers no Mesa >= 25. On Ubuntu 22.04 or 24.04: sudo add-apt-repository ppa:kisak/kisak-mesa, then run this again"
        return 1
    fi
    apt_install -t "$suite" mesa-vulkan-drivers libvulkan1
}

# ---- the work

ready && exit 0
mkdir -p "$TOOLS"
exec 9>"$TOOLS/lock"
flock 9  # `make build` and `make test` may start together
ready && exit 0

UV=$(find_uv || uv_by_pip || uv_by_pipx || uv_by_apt || uv_by_installer) ||
    die "uv is missing and could not be installed by pip, pipx, apt or its installer: see https://docs.astral.sh/uv/"
PYTHON=$(find_python || python_by_uv || python_by_apt) ||
    die "no working Python 3.12 on PATH or under pyenv, and neither uv nor apt could get one: install python3.12, then run this again"
say "uv: $UV; python: $PYTHON"
unset VIRTUAL_ENV
export UV_PROJECT_ENVIRONMENT=$PWD/.venv UV_HTTP_TIMEOUT=${UV_HTTP_TIMEOUT:-300}
if [ "$PROFILE" = core ]; then packages=(--no-default-groups) size=1.2; else packages=(--all-extras --no-extra metrics) size=7; fi
"$UV" sync --frozen "${packages[@]}" --python "$PYTHON" ||
    die "the packages could not be installed: see the message of uv above (about $size GB of disk and a way to pypi.org are needed)"

if ! loads 2>/dev/null; then
    say "installing the system libraries that the packages load"
    { as_root apt-get update >&2 && apt_install libgomp1 libx11-6 libstdc++6; } || say "apt-get needs root, or failed"
    loads >&2 || die "a package does not load (see above): install the library it names, then run this again"
fi
if [ "$PROFILE" = all ] && ! renders; then
    say "SAPIEN finds no Vulkan device: installing Mesa lavapipe"
    install_mesa || say "Mesa could not be installed"
    if ! renders; then
        say "WARNING: no Vulkan device works, so older looks and --render rt cannot be drawn; SAPIEN says:"
        .venv/bin/python -c 'import sapien; sapien.render.RenderSystem()' 2>&1 | tail -n 2 >&2 || true
        exit 0  # no stamp: the next run tries again
    fi
fi
key > "$STAMP"
say "ready; for the command domino-data in this shell: source .venv/bin/activate"
