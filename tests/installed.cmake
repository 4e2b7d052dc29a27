# SPDX-License-Identifier: Apache-2.0
# Steps of the tests that use an installed copy, one a call:
#   cmake -DSTEP=install|consumer|pkgconfig|plugin|broken_plugin|clashing_plugin|throwing_plugin|command
#         -DBUILD=… -DWORK=… -DSOURCE=… -DCXX=… [-DFLAGS=…] -P installed.cmake
# BUILD is rayloom's build folder, WORK a folder of the test's own, SOURCE the folder tests/.
cmake_minimum_required(VERSION 3.25)
# Moved after it was installed: nothing in it may know where it stood.
set(prefix ${WORK}/moved)

function(run)
  cmake_parse_arguments(PARSE_ARGV 0 arg "" "OUTPUT;ERRORS;EXIT" "COMMAND")
  execute_process(COMMAND ${arg_COMMAND} OUTPUT_VARIABLE out ERROR_VARIABLE err RESULT_VARIABLE code)
  if(NOT DEFINED arg_EXIT)
    set(arg_EXIT 0)
  endif()
  if(NOT code EQUAL arg_EXIT)
    list(JOIN arg_COMMAND " " line)
    message(FATAL_ERROR "${line}\nexit code ${code}, expected ${arg_EXIT}\n${out}${err}")
  endif()
  if(arg_OUTPUT)
    set(${arg_OUTPUT} "${out}" PARENT_SCOPE)
  endif()
  if(arg_ERRORS)
    set(${arg_ERRORS} "${err}" PARENT_SCOPE)
  endif()
endfunction()

function(expect text part)
  string(FIND "${text}" "${part}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "expected to find\n  ${part}\nin\n${text}")
  endif()
endfunction()

function(build_outside name)
  run(COMMAND ${CMAKE_COMMAND} -S ${SOURCE}/${name} -B ${WORK}/${name} -G Ninja
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH=${prefix} -DCMAKE_CXX_COMPILER=${CXX} "-DCMAKE_CXX_FLAGS=${FLAGS}")
  run(COMMAND ${CMAKE_COMMAND} --build ${WORK}/${name})
endfunction()

if(STEP STREQUAL install)
  file(REMOVE_RECURSE ${WORK})
  run(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/installed)
  file(RENAME ${WORK}/installed ${prefix})

elseif(STEP STREQUAL consumer)
  build_outside(consumer)
  run(COMMAND ${WORK}/consumer/consumer OUTPUT out)
  expect("${out}" "data: ${prefix}/share/rayloom\n")
  expect("${out}" "twice 0.5 is 1\n")

elseif(STEP STREQUAL pkgconfig)
  file(GLOB_RECURSE pc ${prefix}/*/rayloom.pc)
  cmake_path(GET pc PARENT_PATH folder)
  set(ENV{PKG_CONFIG_PATH} ${folder})
  run(COMMAND pkg-config --cflags --libs rayloom OUTPUT flags)
  separate_arguments(flags UNIX_COMMAND "${flags}")
  separate_arguments(extra UNIX_COMMAND "${FLAGS}")
  cmake_path(GET folder PARENT_PATH libraries)
  run(COMMAND ${CXX} -std=c++20 ${extra} ${SOURCE}/consumer/main.cpp -o ${WORK}/by_pkgconfig ${flags}
    -Wl,-rpath,${libraries})
  run(COMMAND ${WORK}/by_pkgconfig OUTPUT out)
  expect("${out}" "data: ${prefix}/share/rayloom\n")
  expect("${out}" "twice 0.5 is 1\n")

elseif(STEP STREQUAL plugin)
  build_outside(plugin)
  file(REMOVE_RECURSE ${WORK}/plugins)
  file(COPY ${WORK}/plugin/libdespeckle.so DESTINATION ${WORK}/plugins)
  run(COMMAND ${WORK}/consumer/consumer ${WORK}/plugins OUTPUT out)
  expect("${out}" "example.despeckle (${WORK}/plugins/libdespeckle.so)\n")

elseif(STEP STREQUAL broken_plugin)
  file(WRITE ${WORK}/broken/libbroken.so "not a library")
  run(COMMAND ${WORK}/consumer/consumer ${WORK}/broken ERRORS err EXIT 3)
  expect("${err}" "plug-in '${WORK}/broken/libbroken.so'")
  # A folder above the one that was meant.
  file(MAKE_DIRECTORY ${WORK}/above/build)
  run(COMMAND ${WORK}/consumer/consumer ${WORK}/above ERRORS err EXIT 3)
  expect("${err}" "plug-in folder '${WORK}/above' holds no plug-in")

elseif(STEP STREQUAL clashing_plugin)
  # The same node from two files: the second is refused by name, the process lives on.
  file(REMOVE_RECURSE ${WORK}/again)
  file(MAKE_DIRECTORY ${WORK}/again)
  file(COPY_FILE ${WORK}/plugin/libdespeckle.so ${WORK}/again/libcopy.so)
  run(COMMAND ${WORK}/consumer/consumer ${WORK}/plugins:${WORK}/again ERRORS err EXIT 3)
  expect("${err}" "${WORK}/again/libcopy.so")
  expect("${err}" "example.despeckle")

elseif(STEP STREQUAL throwing_plugin)
  # Whatever a node from elsewhere throws, from wherever: an error that names it, the earlier file stays.
  build_outside(throwing_plugin)
  file(REMOVE_RECURSE ${WORK}/throws)
  file(COPY ${WORK}/throwing_plugin/libthrows.so DESTINATION ${WORK}/throws)
  set(ENV{RAYLOOM_PLUGINS} ${WORK}/throws)
  foreach(place create plan compute)
    foreach(what mine bad_alloc int)
      set(exit 70)
      if(what STREQUAL bad_alloc)
        set(exit 5)
      endif()
      file(WRITE ${WORK}/thrown.exr "the earlier file")
      run(COMMAND ${prefix}/bin/rayloom run ${SOURCE}/throwing_plugin/throws.yaml -p place=${place} -p what=${what}
        -i image=${SOURCE}/data/cycles/cornell/stack/s01.exr:Combined -o image=${WORK}/thrown.exr
        ERRORS err EXIT ${exit})
      expect("${err}" "node 'bad' (example.throws)")
      file(READ ${WORK}/thrown.exr content)
      if(NOT content STREQUAL "the earlier file")
        message(FATAL_ERROR "${what} in ${place}: the earlier file is gone")
      endif()
    endforeach()
  endforeach()
  # While it is described, which is while its library is loaded: an error that names the library.
  file(REMOVE_RECURSE ${WORK}/undescribed)
  file(COPY ${WORK}/throwing_plugin/libundescribed.so DESTINATION ${WORK}/undescribed)
  set(ENV{RAYLOOM_PLUGINS} ${WORK}/undescribed)
  run(COMMAND ${prefix}/bin/rayloom nodes ERRORS err EXIT 3)
  expect("${err}" "plug-in '${WORK}/undescribed/libundescribed.so'")
  expect("${err}" "cannot be described: no description today")

elseif(STEP STREQUAL command)
  set(ENV{RAYLOOM_PLUGINS} ${WORK}/plugins)
  run(COMMAND ${prefix}/bin/rayloom nodes OUTPUT out)
  expect("${out}" "example.despeckle")
  file(REMOVE ${WORK}/calm.exr)
  run(COMMAND ${prefix}/bin/rayloom run ${SOURCE}/plugin/image.yaml
    -i image=${SOURCE}/data/cycles/cornell/stack/s01.exr:Combined -o image=${WORK}/calm.exr)
  if(NOT EXISTS ${WORK}/calm.exr)
    message(FATAL_ERROR "the run wrote no ${WORK}/calm.exr")
  endif()
  foreach(file share/man/man1/rayloom.1 share/bash-completion/completions/rayloom)
    file(READ ${prefix}/${file} text)
    expect("${text}" "compare")
  endforeach()

elseif(STEP STREQUAL python)
  set(ENV{PYTHONPATH} ${prefix}/lib/python3/dist-packages)
  set(ENV{RAYLOOM_PLUGINS} ${WORK}/plugins)
  run(COMMAND ${PYTHON} -c
    "import rayloom; print(rayloom.Graph('virtual-flash'), 'example.despeckle' in rayloom.nodes())" OUTPUT out)
  expect("${out}" "<rayloom.Graph 'virtual-flash'> True\n")

else()
  message(FATAL_ERROR "there is no step '${STEP}'")
endif()
