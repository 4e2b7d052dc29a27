# SPDX-License-Identifier: Apache-2.0
# README.md shows files of the tree word for word: the plug-in that the tests build and run, and a graph
# that comes with rayloom. cmake -DSOURCE=… -P readme.cmake
file(READ ${SOURCE}/README.md readme)
foreach(shown "cpp;tests/plugin/despeckle.cpp" "yaml;graphs/ray-histogram-fusion.yaml")
  list(GET shown 0 language)
  list(GET shown 1 file)
  file(READ ${SOURCE}/${file} text)
  string(FIND "${readme}" "```${language}\n${text}```" at)
  if(at EQUAL -1)
    message(SEND_ERROR "README.md does not show ${file} as it is")
  endif()
endforeach()
