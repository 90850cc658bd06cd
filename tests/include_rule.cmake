# The include rule: which folder may include headers of which, and where device and detector SDKs
# may appear. Run as a test; fails with every offending line.

cmake_policy(VERSION 3.25)

set(allowed_core    core)
set(allowed_calib   core calib)
set(allowed_sim     core calib sim)
set(allowed_capture core capture)
set(allowed_stage   core stage)
set(allowed_compare core calib sim compare)
set(allowed_station core calib sim capture stage compare station)
set(allowed_mocks   core calib sim capture stage mocks)
set(allowed_bench   core calib sim capture compare bench)

set(sdk_headers "arv\\.h|libcamera/|linux/videodev2\\.h|modbus|apriltag|tag[0-9A-Za-z]+h[0-9]+\\.h|opencv2/aruco|opencv2/objdetect|yaml-cpp|nlohmann|CLI/|ceres/")

# The one header with an SDK's types: what the .cpp files that write a record's JSON share.
set(json_header station/record/record_json.h)

set(offences "")
foreach(folder core calib sim capture stage compare station mocks bench)
    file(GLOB_RECURSE sources RELATIVE ${ROOT} ${ROOT}/${folder}/*.h ${ROOT}/${folder}/*.cpp)
    foreach(source IN LISTS sources)
        file(STRINGS ${ROOT}/${source} lines REGEX "^#include")
        foreach(line IN LISTS lines)
            if(line MATCHES "^#include \"([a-z]+)/" AND NOT CMAKE_MATCH_1 IN_LIST allowed_${folder})
                string(APPEND offences "  ${source}: ${line}\n")
            elseif(line MATCHES "^#include \"[^/]*\"")
                string(APPEND offences "  ${source}: ${line} (own headers are included from the root)\n")
            elseif(source MATCHES "\\.h$" AND NOT source STREQUAL json_header AND line MATCHES "<(${sdk_headers})")
                string(APPEND offences "  ${source}: ${line} (SDK headers belong in .cpp files)\n")
            endif()
        endforeach()
    endforeach()
endforeach()

if(offences)
    message(FATAL_ERROR "The include rule is broken:\n${offences}")
endif()
message(STATUS "The include rule holds.")
