#!/usr/bin/env bash
# The steps of the GitHub action and of the GitLab template, as examples/ci uses them, run by the shell
# as their runners would: a good camera passes, one with an error fails by the exit code, and what is
# published is there. Exit 77 (skipped) without python3-yaml.
#     tests/ci_templates.sh BUILD_FOLDER
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
export PATH=$1:$PATH
python3 -c 'import yaml' || { echo "python3-yaml is missing"; exit 77; }
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cp -r "$source/examples/ci" "$scratch/repository"
cd "$scratch/repository"

# step PLATFORM: prints a script: the variables that the platform sets, and the step that qualifies.
step() {
    python3 - "$1" "$source" <<'PYTHON'
import re, shlex, sys, yaml
platform, source = sys.argv[1:]
load = lambda path: yaml.safe_load(open(path))
if platform == "github":
    action = load(source + "/ci/github/action.yml")
    job = load(".github/workflows/qualify.yml")["jobs"]["twin"]
    given = next(step["with"] for step in job["steps"] if step["uses"].startswith("your-organisation/etalon"))
    assert set(given) <= set(action["inputs"]), given
    inputs = {name: given.get(name, about["default"]) for name, about in action["inputs"].items()}
    step = next(step for step in action["runs"]["steps"] if step["name"] == "Qualify")
    filled = lambda text: re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda m: inputs[m[1]], text)
    variables = {name: filled(text) for name, text in step["env"].items()}
    script = step["run"]
else:
    template = load(source + "/ci/gitlab/qualify.yml")[".etalon-qualify"]
    job = load(".gitlab-ci.yml")["qualify"]
    variables = {**template["variables"], **job["variables"]}
    script = "\n".join(template["script"])
for name, text in variables.items():
    print(f"export {name}={shlex.quote(text)}")
print(script)
PYTHON
}

# expect CODE PLATFORM
expect() {
    local status=0
    rm -rf etalon-record
    step "$2" >step.sh
    GITHUB_STEP_SUMMARY=summary.md bash --noprofile --norc -eo pipefail step.sh 2>err.txt || status=$?
    [ $status -eq "$1" ] || { cat err.txt; echo "$2: exit code $status, not $1"; exit 1; }
    [ -s etalon-record/report.html ] && grep -q '<testsuite' etalon-record/junit.xml
}
expect 0 github
grep -q 'verdict PASS' summary.md
sed -i 's/errors: {focal_length_percent: 0,/errors: {focal_length_percent: 2,/' twin.yaml
expect 1 gitlab
