#!/bin/sh
# The documentation site is built, without a broken link. Exit 77 (skipped) without mkdocs.
#     tests/docs_site.sh BUILD_FOLDER
command -v mkdocs >/dev/null || { echo "mkdocs is missing (scripts/docs.sh installs it)"; exit 77; }
exec "$(dirname "$0")/../scripts/docs.sh" "$1"
