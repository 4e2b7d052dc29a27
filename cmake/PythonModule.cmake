# SPDX-License-Identifier: Apache-2.0
# The Python module, where pybind11 and Python's headers are. The distribution's own Python is taken,
# whose packages ./dev setup installs, rather than one of a user's environment that comes first in PATH;
# -DPython3_EXECUTABLE=… says otherwise.
option(RAYLOOM_PYTHON "Build the Python module" ON)
if(NOT RAYLOOM_PYTHON)
  return()
endif()
find_program(RAYLOOM_SYSTEM_PYTHON python3 PATHS /usr/bin NO_DEFAULT_PATH)
if(RAYLOOM_SYSTEM_PYTHON AND NOT Python3_EXECUTABLE)
  set(Python3_EXECUTABLE ${RAYLOOM_SYSTEM_PYTHON})
endif()
find_package(Python3 COMPONENTS Interpreter Development.Module)
find_package(pybind11 2.10 QUIET)
if(NOT Python3_Development.Module_FOUND OR NOT pybind11_FOUND)
  message(STATUS "No Python module: pybind11 or Python's headers are missing")
  return()
endif()
file(GLOB RAYLOOM_PYTHON_SOURCES CONFIGURE_DEPENDS lib/python/*.cpp)
Python3_add_library(rayloom_python MODULE WITH_SOABI ${RAYLOOM_PYTHON_SOURCES})
target_link_libraries(rayloom_python PRIVATE rayloom rayloom_warnings pybind11::headers)
file(RELATIVE_PATH RAYLOOM_PYTHON_TO_LIB /prefix/${RAYLOOM_PYTHON_FOLDER} /prefix/${CMAKE_INSTALL_LIBDIR})
set_target_properties(rayloom_python PROPERTIES OUTPUT_NAME rayloom CXX_VISIBILITY_PRESET hidden
  INSTALL_RPATH "$ORIGIN/${RAYLOOM_PYTHON_TO_LIB}"
  LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/${RAYLOOM_PYTHON_FOLDER})
install(TARGETS rayloom_python LIBRARY DESTINATION ${RAYLOOM_PYTHON_FOLDER})
