# SPDX-License-Identifier: Apache-2.0
# cmake --install: library, headers, command, graphs, and what find_package() and pkg-config read.
include(CMakePackageConfigHelpers)

install(TARGETS rayloom EXPORT rayloomTargets
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
if(TARGET rayloom_command)
  install(TARGETS rayloom_command RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  # Manual page and completion are made by the command, from the description of its own options.
  set(RAYLOOM_MANUAL ${CMAKE_BINARY_DIR}/share/man/man1/rayloom.1)
  set(RAYLOOM_COMPLETION ${CMAKE_BINARY_DIR}/share/bash-completion/completions/rayloom)
  cmake_path(GET RAYLOOM_MANUAL PARENT_PATH RAYLOOM_MANUAL_FOLDER)
  cmake_path(GET RAYLOOM_COMPLETION PARENT_PATH RAYLOOM_COMPLETION_FOLDER)
  file(MAKE_DIRECTORY ${RAYLOOM_MANUAL_FOLDER} ${RAYLOOM_COMPLETION_FOLDER})
  add_custom_command(OUTPUT ${RAYLOOM_MANUAL} ${RAYLOOM_COMPLETION}
    COMMAND ${CMAKE_COMMAND} -E env --unset=RAYLOOM_PLUGINS
      $<TARGET_FILE:rayloom_command> docs --man ${RAYLOOM_MANUAL} --completion ${RAYLOOM_COMPLETION}
    DEPENDS rayloom_command VERBATIM)
  add_custom_target(rayloom_manual ALL DEPENDS ${RAYLOOM_MANUAL} ${RAYLOOM_COMPLETION})
  install(FILES ${RAYLOOM_MANUAL} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  install(FILES ${RAYLOOM_COMPLETION} DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
endif()
install(DIRECTORY lib/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/rayloom
  FILES_MATCHING PATTERN "*.h" PATTERN cli EXCLUDE PATTERN python EXCLUDE)
install(DIRECTORY graphs DESTINATION ${RAYLOOM_DATA_FOLDER} FILES_MATCHING PATTERN "*.yaml")
install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR})

install(EXPORT rayloomTargets NAMESPACE rayloom:: DESTINATION ${RAYLOOM_CMAKE_FOLDER})
configure_package_config_file(cmake/rayloomConfig.cmake.in ${CMAKE_BINARY_DIR}/rayloomConfig.cmake
  INSTALL_DESTINATION ${RAYLOOM_CMAKE_FOLDER} PATH_VARS RAYLOOM_DATA_FOLDER)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/rayloomConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/rayloomConfig.cmake ${CMAKE_BINARY_DIR}/rayloomConfigVersion.cmake
  cmake/OpenImageIOTarget.cmake DESTINATION ${RAYLOOM_CMAKE_FOLDER})

# The .pc file lies in <libdir>/pkgconfig; its prefix is found from there.
file(RELATIVE_PATH RAYLOOM_PC_TO_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(cmake/rayloom.pc.in ${CMAKE_BINARY_DIR}/rayloom.pc @ONLY)
install(FILES ${CMAKE_BINARY_DIR}/rayloom.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME rayloom)
set(CPACK_PACKAGE_CONTACT "The rayloom authors <rayloom@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_RESOURCE_FILE_LICENSE ${CMAKE_SOURCE_DIR}/LICENSE)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
# Headers come along, so what they include is wanted too.
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "libopenimageio-dev, libtbb-dev")
include(CPack)
