#!/bin/sh
# usage: sh odm.sh [more options of ODM]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
name=$(basename "$here")
exec docker run --rm -v "$(dirname "$here"):/datasets" opendronemap/odm \
  --project-path /datasets "$name" --cameras "/datasets/$name/cameras.json" "$@"
