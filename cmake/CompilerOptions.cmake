# Warnings are errors, per target, so that headers of dependencies stay out of it.
function(unlidar_compile_options target)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wold-style-cast
    -Wnon-virtual-dtor -Woverloaded-virtual $<$<BOOL:${UNLIDAR_WARNINGS_AS_ERRORS}>:-Werror>
    -ffp-contract=off
  )
  # With these, x86 and arm64 give the same digits: vectorised, Eigen sums in another order on each and
  # fuses multiplications with additions on arm64, for no gain in speed here. What it aligns stays so,
  # for PCL's libraries and the users of this one are built with that.
  target_compile_definitions(${target} PRIVATE
    EIGEN_DONT_VECTORIZE EIGEN_MAX_STATIC_ALIGN_BYTES=16)
endfunction()

# Of everything: a sanitizer that sees a part of the program only is of no use.
if(UNLIDAR_SANITIZE)
  add_compile_options(-fsanitize=${UNLIDAR_SANITIZE} -fno-sanitize-recover=all
    -fno-omit-frame-pointer -D_GLIBCXX_ASSERTIONS
    -fsanitize-ignorelist=${PROJECT_SOURCE_DIR}/cmake/foreign_headers.ignorelist)
  add_link_options(-fsanitize=${UNLIDAR_SANITIZE})
endif()
if(UNLIDAR_COVERAGE)
  add_link_options(-fprofile-instr-generate)
endif()
# What is counted: the lines of the program, not those of its tests.
function(unlidar_counted target)
  if(UNLIDAR_COVERAGE)
    target_compile_options(${target} PRIVATE -fprofile-instr-generate -fcoverage-mapping
      -fprofile-list=${PROJECT_SOURCE_DIR}/cmake/foreign_headers.profilelist)
  endif()
endfunction()
# What a fuzzer is to see: the library and itself, not the tests. Comparisons guide it through texts
# and headers. In the mathematics, whose results no mutation aims at, watching them takes most of the
# time.
function(unlidar_fuzzed target)
  target_compile_options(${target} PRIVATE
    -fsanitize=fuzzer-no-link -fno-sanitize-coverage=trace-cmp)
endfunction()
if(UNLIDAR_BUILD_FUZZERS)
  file(GLOB parsers src/config/config*.cpp src/io/*.cpp)
  set_source_files_properties(${parsers} PROPERTIES COMPILE_OPTIONS -fsanitize-coverage=trace-cmp)
endif()
