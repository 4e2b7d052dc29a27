# SPDX-License-Identifier: Apache-2.0
# Debian's OpenImageIO target names include folders of optional packages (OpenCV) that need not be
# installed, and CMake refuses targets with missing folders. Nothing rayloom includes needs them.
get_target_property(_rayloom_dirs OpenImageIO::OpenImageIO INTERFACE_INCLUDE_DIRECTORIES)
set(_rayloom_kept)
foreach(_rayloom_dir IN LISTS _rayloom_dirs)
  if(EXISTS "${_rayloom_dir}")
    list(APPEND _rayloom_kept "${_rayloom_dir}")
  endif()
endforeach()
set_target_properties(OpenImageIO::OpenImageIO PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_rayloom_kept}")
