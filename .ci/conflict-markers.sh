#!/bin/sh
# Refuses lines that a merge left behind. A line of seven equals signs alone may underline a title: it is no proof.
set -eu

if git grep -nE '^(<<<<<<<|>>>>>>>|[|]{7})( |$)' -- .; then
    echo "conflict markers are committed in the lines above: resolve them" >&2
    exit 1
fi
