# Warnings are errors, per target, so that headers of dependencies stay out of it.
function(unlidar_compile_options target)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wold-style-cast
    -Wnon-virtual-dtor -Woverloaded-virtual -Werror
    -ffp-contract=off  # x86 and arm give the same digits
  )
endfunction()
