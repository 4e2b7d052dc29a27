# SPDX-License-Identifier: Apache-2.0
# Flags of rayloom's own sources; never handed on to those who link it.
add_library(rayloom_warnings INTERFACE)
target_compile_options(rayloom_warnings INTERFACE
  -Wall -Wextra -Wshadow -Wconversion
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict> # false alarms on std::string in g++ 12 (GCC bug 105651)
  -ffp-contract=off        # the same bits on every SIMD target
  -march=x86-64-v2)        # wider targets are chosen at run time
if(RAYLOOM_WERROR)
  target_compile_options(rayloom_warnings INTERFACE -Werror)
endif()
if(RAYLOOM_SANITIZE)
  target_compile_options(rayloom_warnings INTERFACE
    -fsanitize=${RAYLOOM_SANITIZE} -fno-omit-frame-pointer -g1)
  target_link_options(rayloom_warnings INTERFACE -fsanitize=${RAYLOOM_SANITIZE})
endif()
