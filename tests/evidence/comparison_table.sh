#!/usr/bin/env bash
# The table of docs/validation.md, from the folder that `etalon compare --out DIR` wrote: a row for
# each photograph of comparison.csv, and the means.
set -euo pipefail
awk -F, '
function cell(name, digits) { return $(at[name]) == "" ? "–" : sprintf("%." digits "f", $(at[name])) }
function add(name) { if ($(at[name]) != "") { sum[name] += $(at[name]); count[name]++ } }
function mean(name, digits) { return count[name] ? sprintf("%." digits "f", sum[name] / count[name]) : "–" }
NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i
    print "| photo | residual, refined / gray | edge shift, refined / px | blur σ / px | along edges: shift, blur, photometric, rest / gray | findings |"
    print "|---|---|---|---|---|---|"; next }
{ name = $1; sub(/.*\//, "", name)
  print "| " name " | " cell("rms_gray", 2) ", " cell("refined_rms_gray", 2) " | " \
    cell("edge_shift_rms_px", 3) ", " cell("refined_edge_shift_rms_px", 3) " | " cell("psf_sigma_px", 2) " | " \
    cell("refined_band_shift_gray", 1) ", " cell("refined_band_blur_gray", 1) ", " \
    cell("refined_band_photometric_gray", 1) ", " cell("refined_band_rest_gray", 1) " | " $(at["findings"]) " |"
  add("rms_gray"); add("refined_rms_gray"); add("edge_shift_rms_px"); add("refined_edge_shift_rms_px"); add("psf_sigma_px") }
END { print "| **mean** | " mean("rms_gray", 2) ", " mean("refined_rms_gray", 2) " | " mean("edge_shift_rms_px", 3) ", " \
    mean("refined_edge_shift_rms_px", 3) " | " mean("psf_sigma_px", 2) " | | |" }' "$1/comparison.csv"
