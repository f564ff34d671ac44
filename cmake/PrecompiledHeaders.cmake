# Precompiled headers: those of the standard library and of the libraries that most sources include, compiled once for
# the modules and once for the tests, which are compiled with other options. Only headers that never change here, so that an edit
# of ours compiles no more than before. Every source still includes what it uses: CAIRN_PRECOMPILE_HEADERS=OFF builds too,
# and clang-tidy sees the sources so.

set(CAIRN_COMMON_HEADERS
  <absl/status/status.h> <absl/status/statusor.h> <absl/strings/str_cat.h> <absl/strings/str_format.h>
  <absl/strings/string_view.h>
  <Eigen/Cholesky> <Eigen/Core> <Eigen/Geometry> <Eigen/LU>
  <opencv2/core.hpp>
  <algorithm> <array> <atomic> <chrono> <cmath> <condition_variable> <cstdint> <cstdio> <cstring> <deque> <filesystem>
  <fstream> <functional> <iostream> <limits> <map> <memory> <mutex> <numbers> <numeric> <optional> <random> <set> <span>
  <sstream> <string> <thread> <unordered_map> <unordered_set> <utility> <variant> <vector>)

# cairn_header_library(NAME HEADERS <header>... DEPENDS library...): what cairn_precompiled_headers() refers to.
function(cairn_header_library name)
  cmake_parse_arguments(ARG "" "" "HEADERS;DEPENDS" ${ARGN})
  set(source ${CMAKE_BINARY_DIR}/${name}.cc)
  if(NOT EXISTS ${source})
    file(WRITE ${source} "// Compiled for its precompiled header.\n")
  endif()
  add_library(${name} OBJECT EXCLUDE_FROM_ALL ${source})
  target_link_libraries(${name} PRIVATE cairn_options ${ARG_DEPENDS})
  target_include_directories(${name} SYSTEM PRIVATE ${OpenCV_INCLUDE_DIRS} ${EIGEN3_INCLUDE_DIRS})
  target_precompile_headers(${name} PRIVATE ${ARG_HEADERS})
  set_target_properties(${name} PROPERTIES UNITY_BUILD OFF)
endfunction()

function(cairn_precompiled_headers target headers)
  if(CAIRN_PRECOMPILE_HEADERS)
    target_precompile_headers(${target} REUSE_FROM ${headers})
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
      target_compile_options(${target} PRIVATE -fpch-preprocess)  # for ccache
    endif()
  endif()
endfunction()

# Tests run for seconds: less optimization costs them less than it saves the compiler. What they test is optimized.
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  set(CAIRN_TEST_OPTIMIZATION -O1 -Wno-maybe-uninitialized)  # g++ 12 misjudges std::optional at -O1
endif()

if(CAIRN_PRECOMPILE_HEADERS)
  cairn_header_library(cairn_library_headers HEADERS ${CAIRN_COMMON_HEADERS}
                       DEPENDS absl::status absl::statusor absl::strings absl::str_format spdlog::spdlog Threads::Threads)
  if(CAIRN_BUILD_TESTS)
    cairn_header_library(cairn_test_headers HEADERS ${CAIRN_COMMON_HEADERS} <gmock/gmock.h> <gtest/gtest.h>
                         DEPENDS absl::status absl::statusor absl::strings absl::str_format spdlog::spdlog Threads::Threads
                                 GTest::gmock)
    set_target_properties(cairn_test_headers PROPERTIES POSITION_INDEPENDENT_CODE OFF)
    target_compile_options(cairn_test_headers PRIVATE ${CAIRN_TEST_OPTIMIZATION})
  endif()
endif()
