# Reads every file for its errors and warnings and generates no code, which takes most of the time. Included after
# project(): the checks of the compiler itself need real objects. Outputs are empty files, so that a file is read again
# only when it or what it includes has changed. The option -fsyntax-only comes with orbid_flags, for a cache of compilers'
# results knows it; precompiled headers are made nevertheless.
if(NOT CMAKE_CXX_COMPILER_ID STREQUAL Clang)
  message(FATAL_ERROR "ORBID_SYNTAX_ONLY needs Clang, not ${CMAKE_CXX_COMPILER_ID}")
endif()
set(CMAKE_CXX_COMPILE_OBJECT
  "<CMAKE_CXX_COMPILER> <DEFINES> <INCLUDES> <FLAGS> -o <OBJECT> -c <SOURCE>"
  "<CMAKE_COMMAND> -E touch <OBJECT>")
set(CMAKE_CXX_CREATE_STATIC_LIBRARY "<CMAKE_COMMAND> -E touch <TARGET>")
set(CMAKE_CXX_CREATE_SHARED_LIBRARY "<CMAKE_COMMAND> -E touch <TARGET>")
set(CMAKE_CXX_CREATE_SHARED_MODULE "<CMAKE_COMMAND> -E touch <TARGET>")
set(CMAKE_CXX_LINK_EXECUTABLE "<CMAKE_COMMAND> -E touch <TARGET>")
# Precompiled headers are named by paths that are the same in every clone (add_precompiled() says which are included), so
# that a cache finds them; CMake's own options hold the path of the build.
set(CMAKE_CXX_COMPILE_OPTIONS_CREATE_PCH -Xclang -emit-pch -x c++-header)
set(CMAKE_CXX_COMPILE_OPTIONS_USE_PCH -include-pch <PCH_FILE>)
