// The texts of a record: run.json, poses.csv, convergence.csv and junit.xml. The log is
// station/record/run_events.h.
//
// Numbers are written so that they read back as the same double. What is unknown, infinite or not
// measured is null in JSON and empty in CSV. Bytes that are not UTF-8 are replaced.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

// `etalon: run/1`, indented, keys in a fixed order. Also what --json prints.
std::string run_json(const QualifyResult& result);

// One row per visited pose. Linear axes in mm, rotary axes in deg; poses as rotation vector (rad)
// and translation (mm); biases in mm (camera frame) and mrad (marker frame).
std::string poses_csv(const QualifyResult& result);

// One row per round of the bias-corrected registration: how far it moved a predicted corner.
std::string convergence_csv(const QualifyResult& result);

// What a run judged, for CI systems. The format has no standard; this keeps to what Jenkins' xunit
// schema and GitLab read: testsuites, testsuite, testcase with failure, error or skipped. One test
// case per judged quantity, and `verdict` for the run as a whole, last:
//
//     FAIL                      failure
//     INCONCLUSIVE              error: the run could not tell, which is not the camera's fault
//     SKIPPED, NOT_OBSERVABLE   skipped, with the reason; the verdict is an error then
//     ERROR, ABORTED            error, of the verdict: no quantity was judged
//
// A job is green only where the verdict is PASS.
std::string junit_xml(const QualifyResult& result);

}  // namespace etalon
