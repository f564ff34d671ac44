# One folder = one static library `cairn::<folder>`, with the unit tests and benchmarks that sit beside its code.

add_library(cairn_options INTERFACE)
target_compile_options(cairn_options INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Werror)
if(CAIRN_SANITIZE)
  # Instrumented code misleads g++'s analysis of what may be uninitialized.
  target_compile_options(cairn_options INTERFACE -fsanitize=${CAIRN_SANITIZE} -fno-omit-frame-pointer
                         -Wno-maybe-uninitialized)
  target_link_options(cairn_options INTERFACE -fsanitize=${CAIRN_SANITIZE})
endif()

if(CAIRN_FUZZ)
  # Warnings are g++'s business.
  set(fuzz_sanitizers -fsanitize=address,undefined -fno-sanitize-recover=undefined)
  target_compile_options(cairn_options INTERFACE -w ${fuzz_sanitizers} -fsanitize=fuzzer-no-link -fno-omit-frame-pointer)
  target_link_options(cairn_options INTERFACE ${fuzz_sanitizers})
endif()

include(${CMAKE_CURRENT_LIST_DIR}/PrecompiledHeaders.cmake)

# cairn_module(NAME DEPENDS cairn::other library ... [PRIVATE_DEPENDS ...] [TEST_DEPENDS ...])
# Sources: every *.cc here but *_test.cc (one gtest binary, label unit) and *_benchmark.cc (one benchmark binary).
# Files named *_avx2.cc and *_avx512.cc are compiled for those instruction sets; only they are.
function(cairn_module name)
  cmake_parse_arguments(ARG "" "" "DEPENDS;PRIVATE_DEPENDS;TEST_DEPENDS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS *.cc)
  file(GLOB tests CONFIGURE_DEPENDS *_test.cc)
  file(GLOB benchmarks CONFIGURE_DEPENDS *_benchmark.cc)
  if(tests)
    list(REMOVE_ITEM sources ${tests})
  endif()
  if(benchmarks)
    list(REMOVE_ITEM sources ${benchmarks})
  endif()
  foreach(source IN LISTS sources)
    if(source MATCHES "_avx2\\.cc$")
      set_source_files_properties(${source} PROPERTIES COMPILE_OPTIONS "-mavx2;-mfma")
    elseif(source MATCHES "_avx512\\.cc$")
      # GCC 12 warns about its own AVX-512 headers.
      set_source_files_properties(${source} PROPERTIES COMPILE_OPTIONS
        "-mavx512f;-mavx512bw;-mavx512dq;-mavx512vl;-mfma;-Wno-maybe-uninitialized;-Wno-uninitialized")
    endif()
    if(source MATCHES "_avx(2|512)\\.cc$")
      set_source_files_properties(${source} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
    endif()
  endforeach()

  set(target cairn_${name})
  if(sources)
    add_library(${target} STATIC ${sources})
    set(scope PUBLIC)
    target_link_libraries(${target} PRIVATE cairn_options ${ARG_PRIVATE_DEPENDS})
    cairn_precompiled_headers(${target} cairn_library_headers)
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  add_library(cairn::${name} ALIAS ${target})
  target_include_directories(${target} ${scope} ${PROJECT_SOURCE_DIR}/src)
  # Headers of libraries are not ours to warn about.
  target_include_directories(${target} SYSTEM ${scope} ${OpenCV_INCLUDE_DIRS} ${EIGEN3_INCLUDE_DIRS})
  target_link_libraries(${target} ${scope} ${ARG_DEPENDS})

  if(CAIRN_BUILD_TESTS AND tests)
    cairn_test(${name}_test LABELS unit SOURCES ${tests} DEPENDS cairn::${name} ${ARG_TEST_DEPENDS})
  endif()
  if(CAIRN_BUILD_BENCHMARKS AND benchmarks)
    add_executable(${name}_benchmark ${benchmarks})
    target_link_libraries(${name}_benchmark PRIVATE cairn_options cairn::${name} benchmark::benchmark_main)
  endif()
endfunction()

# cairn_test(NAME LABELS label... SOURCES file... DEPENDS library...)
function(cairn_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "LABELS;SOURCES;DEPENDS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  cairn_precompiled_headers(${name} cairn_test_headers)
  # Tests are compiled one by one: each has a small world of its own, often of the same name. Position independence is left
  # to the compiler, as in cairn_test_headers.
  set_target_properties(${name} PROPERTIES POSITION_INDEPENDENT_CODE OFF UNITY_BUILD OFF)
  target_compile_options(${name} PRIVATE ${CAIRN_TEST_OPTIMIZATION})
  target_link_libraries(${name} PRIVATE cairn_options ${ARG_DEPENDS} GTest::gmock GTest::gtest_main)
  gtest_discover_tests(${name} TEST_PREFIX ${name}. DISCOVERY_MODE PRE_TEST
                       PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT ${ARG_TIMEOUT})
endfunction()
