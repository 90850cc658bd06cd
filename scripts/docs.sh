#!/usr/bin/env bash
# Makes the documentation site in build/docs/site: the pages of docs/, README.md, a page with the help
# of every command, the notebooks with what they print and plot, and the references of the libraries
# in C++ (installed headers, by doxygen) and in Python (both where the build has Python's module).
# Strict: a broken link or a page that the navigation does not name ends it.
#     scripts/docs.sh [BUILD_FOLDER]          default: build/release
set -euo pipefail
cd "$(dirname "$0")/.."
build=$(realpath "${1:-build/release}")
. scripts/packages.sh
mkdir -p build
# shellcheck disable=SC2086
install_packages $docs_packages

pages=build/docs/pages
rm -rf build/docs
mkdir -p $pages
cp -r docs/. README.md CHANGELOG.md THIRD_PARTY.md LICENSE CITATION.cff $pages
# All pages lie in one folder there.
sed -i 's#](docs/#](#g' $pages/README.md $pages/CHANGELOG.md
sed -i 's#](\.\./README\.md#](README.md#g' $pages/*.md

# The page of commands, as each explains itself.
{
    printf '# Commands\n\n`--json` gives every result as JSON. Exit codes: 0 PASS or done, 1 FAIL, '
    printf '2 INCONCLUSIVE, 3 bad input,\n4 device or run error, 130 interrupted.\n'
    "$build"/etalon completion commands | while IFS=$'\t' read -r command _; do
        # shellcheck disable=SC2086  # several words
        printf '\n## etalon %s\n\n```text\n%s\n```\n' "$command" "$("$build"/etalon $command --help)"
    done
    printf '\n## etalon-twin\n\n```text\n%s\n```\n' "$("$build"/etalon-twin --help)"
} >$pages/commands.md

# Python's reference, and the notebooks as they run now.
if compgen -G "$build/python/etalon/_etalon*.so" >/dev/null; then
    export PYTHONPATH=$build/python
    /usr/bin/python3 scripts/python_reference.py python/etalon/__init__.pyi >$pages/python-reference.md
    MPLBACKEND=Agg /usr/bin/python3 scripts/notebook_pages.py $pages/notebooks examples/notebooks/*.py
else
    mkdir $pages/notebooks
    for page in python-reference $(basename -s .py -a examples/notebooks/*.py | sed 's#^#notebooks/#'); do
        printf '# %s\n\nNot made: the build has no Python module.\n' "$page" >"$pages/$page.md"
    done
fi
printf '\nEvery type and function: [C++ reference](cpp/index.html).\n' >>$pages/library.md
headers=build/docs/headers
cmake -D SOURCE_DIR="$PWD" -D BINARY_DIR=$headers -D CMAKE_INSTALL_PREFIX="$PWD/$headers/installed" \
    -P cmake/install_headers.cmake >/dev/null
doxygen scripts/Doxyfile

unnamed=$(cd $pages && find . -name '*.md' | sed 's#^\./##' | while read -r page; do
    grep -qF "$page" "$OLDPWD/scripts/mkdocs.yml" || echo "$page"
done)
[ -z "$unnamed" ] || { echo "scripts/mkdocs.yml does not name: $unnamed" >&2; exit 1; }
# Links to a heading are not looked at by mkdocs itself.
mkdocs build --config-file scripts/mkdocs.yml --quiet
python3 scripts/check_anchors.py build/docs/site
echo "site build/docs/site/start-here.html"
