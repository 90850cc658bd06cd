#!/usr/bin/env bash
# The doors of the program: what stands in the way of a command, a file, an option or a request, and
# what comes of it. Each line says what is tried and what came out.
#
#     tests/evidence/doors.sh [PART OF A NAME]
#
# Needs build/release with Python's module. Exit 0 when all hold.
set -uo pipefail
project=$(cd "$(dirname "$0")/../.." && pwd)
bin=${ETALON_BIN:-$project/build/release}
export PATH=$bin:$PATH
only=${1:-}
python=$(command -v /usr/bin/python3 || echo python3)  # the module is of the system's
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work" || exit 1
cp "$project"/examples/demo/* .
status=0

# door WHAT, EXPECTED EXIT CODE, EXPECTED WORDS, COMMAND...: words may be in stdout or stderr.
door() {
    local what=$1 code=$2 words=$3 said came
    shift 3
    if [[ $what != *"$only"* ]]; then return; fi
    said=$(timeout 60 bash -c "$*" 2>&1)
    came=$?
    local right=held
    if [ "$came" -ne "$code" ] || ! grep -qE -- "$words" <<<"$said"; then right=BROKEN; status=1; fi
    printf '%-7s %s\n        %s\n        -> %d, %s\n' "$right" "$what" "$*" "$came" "$({ grep -E -m 1 -- "$words" <<<"$said" || tail -n 1 <<<"$said"; } | cut -c 1-160)"
}
same() { echo "cmp -s '$1' '$2' && echo the same"; }

marker=apriltag:36h11:5@80mm
photo="etalon render --camera camera.yml --marker $marker --pose 0,0,0,10,-5,500 --out photo.png"
bash -c "$photo" 2>/dev/null

echo "== standard descriptors"
sed 's/count: .*/count: 20/; s/^camera: .*/camera: camera.yml/; /^disturbances:/,$d' "$project"/examples/study/disturbed.yaml >small.yaml
door "a study without stderr keeps its rows" 0 '^[a-z_]+,.*' \
    "etalon study small.yaml --out study 2>&- >/dev/null; head -n 1 study/results.csv | cut -c 1-60"
door "full stderr ends no detection" 0 '' \
    "etalon detect --marker $marker --camera camera.yml photo.png 2>/dev/full"
door "closed stderr ends no render" 0 '' "$photo 2>&-"
door "a full stdout is said" 4 'cannot be written' \
    "etalon detect --marker $marker --camera camera.yml photo.png >/dev/full"

echo "== what is written"
cp camera.yml kept.yml
door "no output over its input" 3 'is an input' \
    "etalon camera convert kept.yml --to etalon --out kept.yml; c=\$?; cmp kept.yml camera.yml && exit \$c"
ln -sf kept.yml link.yml
door "nor by a link" 3 'is an input' "etalon camera convert kept.yml --to etalon --out link.yml"
ln kept.yml hard.yml
door "nor by a hard link" 3 'is an input' "etalon camera convert kept.yml --to etalon --out hard.yml"
echo old >target.yml; chmod 640 target.yml; ln -sf target.yml out.yml
door "a link's target is written, and keeps its mode" 0 '640.*out.yml' \
    "etalon camera convert camera.yml --to etalon --out out.yml && test -L out.yml && stat -c '%a' target.yml | tr '\n' ' ' && ls out.yml"
mkfifo pipe
door "a FIFO is written to and not replaced" 0 'prw' \
    "timeout 5 cat pipe >/dev/null & etalon camera convert camera.yml --to etalon --out pipe; c=\$?; wait; ls -l pipe; exit \$c"
door "stdout may be the file" 0 'camera/1' "etalon camera convert camera.yml --to etalon --out /dev/stdout"

echo "== two at once"
printf 'rx,ry,rz,tx,ty,tz\n' >poses.csv
for i in $(seq 1000); do echo "0,0,0,$((i % 40)),0,500" >>poses.csv; done
door "two into one folder: one is refused" 3 'is in use' \
    "r='etalon render --camera camera.yml --marker $marker --poses poses.csv --out set'; \$r 2>/dev/null & until [ -e set/images.jsonl ]; do :; done; \$r; c=\$?; wait; exit \$c"

echo "== words of others"
sed 's/^id: .*/id: "a\\nverdict PASS"/' station.yaml >forged.yaml
door "a name cannot forge a line" 3 'control character' "etalon plan forged.yaml"
door "nor an argument" 3 'holds a control character' "etalon camera show \$'a\\nverdict PASS'"

echo "== reasons"
mkdir folder; ln -sf loop2 loop1; ln -sf loop1 loop2
door "a folder" 3 'is a folder' "etalon camera show folder"
door "a FIFO" 3 'is a FIFO' "etalon camera show pipe"
door "a device" 3 'is a device' "etalon camera show /dev/null"
door "a loop of links" 3 'cannot be read' "etalon camera show loop1"
sed 's/fx: 431.0/fx: 431,0/' camera.yml >comma.yml
door "a decimal comma" 3 'decimal point' "etalon camera show comma.yml"
sed 's/^  /\t/' camera.yml >tab.yml
door "a tab" 3 'tab' "etalon camera show tab.yml"
sed '/^etalon:/d' camera.yml >headless.yml
door "no first line" 3 "must begin with 'etalon: camera/1'" "etalon camera show headless.yml"
door "an address that is not here" 3 '^etalon: --listen' "etalon serve station.yaml --listen 8.8.8.8 --records ."
door "the same photograph twice" 3 'twice|more than once' \
    "etalon detect --marker $marker --camera camera.yml photo.png ./photo.png"
printf 'a,b\n1,2\n' >wrong.csv
door "another CSV header is shown" 3 "not 'a,b'" \
    "etalon render --camera camera.yml --marker $marker --poses wrong.csv --out other"
sed 's/host: [^,}]*/host: nobody.invalid/' station.yaml >nobody.yaml
door "an unknown host" 4 "no host 'nobody.invalid' is known" "etalon stage status nobody.yaml"

echo "== options"
door "a command that is not there" 3 'did you mean|calibrate' "etalon calibrat photo.png"
door "an option that is not there" 3 'did you mean|--camera' "etalon detect --camra camera.yml photo.png"

echo "== limits and plans"
sed -E '/_max_mm/s/limit: [0-9.]+/limit: 0.01/' limits.yaml >low.yaml
sed 's/^limits: .*/limits: low.yaml/' station.yaml >low_station.yaml
door "a maximum's limit below its RMS'" 3 'no maximum is below its RMS' "etalon plan low_station.yaml"
sed 's/poses: 100/poses: 9/; s/repeats: 8/repeats: 1/' station.yaml >few.yaml
door "too few poses for a verdict, before anything moves" 3 'too few for a verdict.*--few-poses' \
    "etalon qualify few.yaml --out few"

echo "== Python"
snippet() { door "$1" 1 "$2" "PYTHONPATH=$bin/python $python -c 'import etalon, numpy, pickle; c = etalon.Camera.load(\"camera.yml\"); $3'"; }
snippet "numpy.longdouble" 'TypeError: points_camera: must be an array' 'c.project(numpy.ones((2, 3), numpy.longdouble))'
snippet "another rank" 'ValueError|TypeError|ConfigError' 'c.project(numpy.ones((2, 2)))'
snippet "an argument of another type is named" 'TypeError: [a-z_]+: must be' 'etalon.Renderer("marker").render(c)'
door "a camera pickles" 0 'True' "PYTHONPATH=$bin/python $python -c 'import etalon, pickle; c = etalon.Camera.load(\"camera.yml\"); print(str(pickle.loads(pickle.dumps(c))) == str(c))'"

echo "== page"
etalon serve station.yaml --records . --port 0 >serve.out 2>&1 &
server=$!
trap 'kill $server 2>/dev/null; rm -rf "$work"' EXIT
for _ in $(seq 50); do grep -q 'http://' serve.out && break; sleep 0.1; done
port=$(sed -n 's|.*http://127.0.0.1:\([0-9]*\).*|\1|p' serve.out | head -n 1)
page() { door "$1" 0 "$2" "python3 -c '
import http.client
c = http.client.HTTPConnection(\"127.0.0.1\", $port, timeout=5)
$3
r = c.getresponse(); print(r.status, len(r.read()))'"; }
page "Range is ignored, not half answered" '^200 [0-9]{3,}' 'c.request("GET", "/", headers={"Range": "bytes=0-5"})'
page "a Content-Length that is none" '^400' 'c.putrequest("POST", "/api/live/set"); c.putheader("Content-Length", "abc"); c.endheaders()'
page "another media type" '^4' 'c.request("POST", "/api/live/set", body="{}", headers={"Content-Type": "application/jsonevil"})'
page "a record's name that is no name" '^4' 'c.request("GET", "/report?record=%00")'
exit $status
