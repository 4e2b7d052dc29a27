# SPDX-License-Identifier: Apache-2.0
# README.md shows the plug-in the tests build and run, word for word: cmake -DSOURCE=… -P readme.cmake
file(READ ${SOURCE}/README.md readme)
file(READ ${SOURCE}/tests/plugin/despeckle.cpp example)
string(FIND "${readme}" "```cpp\n${example}```" at)
if(at EQUAL -1)
  message(FATAL_ERROR "README.md does not show tests/plugin/despeckle.cpp as it is")
endif()
