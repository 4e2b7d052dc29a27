# SPDX-License-Identifier: Apache-2.0
# Where things go under the prefix, and from where they find one another: always by relative paths, so
# that an installed copy can be moved as a whole.
if(CMAKE_INSTALL_PREFIX_INITIALIZED_TO_DEFAULT)
  set(CMAKE_INSTALL_PREFIX ${CMAKE_SOURCE_DIR}/dist CACHE PATH "Where to install" FORCE)
endif()
# Debian's multiarch folder under any prefix, not under /usr alone.
if(EXISTS /etc/debian_version AND CMAKE_LIBRARY_ARCHITECTURE)
  set(CMAKE_INSTALL_LIBDIR lib/${CMAKE_LIBRARY_ARCHITECTURE} CACHE PATH "Folder of libraries")
endif()
include(GNUInstallDirs)
set(RAYLOOM_CMAKE_FOLDER ${CMAKE_INSTALL_LIBDIR}/cmake/rayloom)
set(RAYLOOM_DATA_FOLDER ${CMAKE_INSTALL_DATADIR}/rayloom)
set(RAYLOOM_PYTHON_FOLDER lib/python3/dist-packages) # where Debian's Python looks under /usr and /usr/local

file(RELATIVE_PATH RAYLOOM_BIN_TO_LIB /prefix/${CMAKE_INSTALL_BINDIR} /prefix/${CMAKE_INSTALL_LIBDIR})
file(RELATIVE_PATH RAYLOOM_LIB_TO_DATA /prefix/${CMAKE_INSTALL_LIBDIR} /prefix/${RAYLOOM_DATA_FOLDER})
set(CMAKE_INSTALL_RPATH "$ORIGIN/${RAYLOOM_BIN_TO_LIB}")
set(CMAKE_BUILD_RPATH_USE_ORIGIN ON)
