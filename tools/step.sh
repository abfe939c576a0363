#!/bin/sh
# step.sh WHAT COMMAND...: say what is done and how long it took; the command's output only if it fails.
what=$1
shift
log=$(mktemp "${TMPDIR:-/tmp}/trunnion-step.XXXXXX") || exit 1
trap 'rm -f "$log"' EXIT
begin=$(date +%s)
printf '%s ...\n' "$what"
"$@" >"$log" 2>&1
code=$?
if [ "$code" -ne 0 ]; then
    cat "$log" >&2
    printf '%s: failed with exit code %s\n' "$what" "$code" >&2
    exit "$code"
fi
printf '  done in %s s\n' "$(($(date +%s) - begin))"
