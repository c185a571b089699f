# Warnings are errors, per target, so that headers of dependencies stay out of it.
function(unlidar_compile_options target)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wold-style-cast
    -Wnon-virtual-dtor -Woverloaded-virtual -Werror
    -ffp-contract=off  # x86 and arm give the same digits
  )
endfunction()

# Of everything: a sanitizer that sees a part of the program only is of no use.
if(UNLIDAR_SANITIZE)
  add_compile_options(-fsanitize=${UNLIDAR_SANITIZE} -fno-sanitize-recover=all
    -fno-omit-frame-pointer -D_GLIBCXX_ASSERTIONS)
  add_link_options(-fsanitize=${UNLIDAR_SANITIZE})
endif()
if(UNLIDAR_COVERAGE)
  add_compile_options(-fprofile-instr-generate -fcoverage-mapping)
  add_link_options(-fprofile-instr-generate)
endif()
# Comparisons guide a fuzzer through texts and headers. In the mathematics, whose results no mutation
# aims at, watching them takes most of the time.
if(UNLIDAR_BUILD_FUZZERS)
  add_compile_options(-fsanitize=fuzzer-no-link -fno-sanitize-coverage=trace-cmp)
  file(GLOB parsers src/app/config*.cpp src/io/*.cpp src/trajectory/output_times.cpp)
  set_source_files_properties(${parsers} PROPERTIES COMPILE_OPTIONS -fsanitize-coverage=trace-cmp)
endif()
