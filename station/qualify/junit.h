// junit.xml: what a run judged, in the words of CI systems. The format has no standard; this keeps
// to what Jenkins' xunit schema and GitLab read: testsuites, testsuite, testcase with failure,
// error or skipped.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

// One test case per judged quantity, and `verdict` for the run as a whole, last:
//
//     FAIL                      failure
//     INCONCLUSIVE              error: the run could not tell, which is not the camera's fault
//     SKIPPED, NOT_OBSERVABLE   skipped, with the reason; the verdict is an error then
//     ERROR, ABORTED            error, of the verdict: no quantity was judged
//
// So a job is green only where the verdict is PASS.
std::string junit_xml(const QualifyResult& result);

}  // namespace etalon
