# Warnings are errors, per target, so that headers of dependencies stay out of it.
function(unlidar_compile_options target)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wold-style-cast
    -Wnon-virtual-dtor -Woverloaded-virtual -Werror
    -ffp-contract=off  # x86 and arm give the same digits
  )
endfunction()

# Of everything: a sanitizer that sees a part of the program only is no use.
if(UNLIDAR_SANITIZE)
  add_compile_options(-fsanitize=${UNLIDAR_SANITIZE} -fno-sanitize-recover=all
    -fno-omit-frame-pointer -D_GLIBCXX_ASSERTIONS)
  add_link_options(-fsanitize=${UNLIDAR_SANITIZE})
endif()
if(UNLIDAR_BUILD_FUZZERS)
  add_compile_options(-fsanitize=fuzzer-no-link)
endif()
