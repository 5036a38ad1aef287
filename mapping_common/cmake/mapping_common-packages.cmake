# SPDX-License-Identifier: BSD-3-Clause
#
# How the packages of this workspace are built, tested, installed and exported. Their CMakeLists.txt begin with
#
#   find_package(catkin REQUIRED)
#   set(Python3_EXECUTABLE ${PYTHON_EXECUTABLE})  # Debian's pluginlib looks for a Python of its own
#   find_package(mapping_common REQUIRED)
#   mapping_package()
#
# and end with mapping_install(). Each target's name begins with the package's; programs are called what rosrun calls
# them. For those who only use a package, nothing here has an effect.

set(MAPPING_TARGETS_FILE ${CMAKE_CURRENT_LIST_DIR}/mapping-targets.cmake)

# mapping_package(): sets C++17, an optimised build where nothing else is asked for, and warnings.
macro(mapping_package)
  set(CMAKE_CXX_STANDARD 17)
  set(CMAKE_CXX_STANDARD_REQUIRED ON)
  if(NOT CMAKE_BUILD_TYPE)
    set(CMAKE_BUILD_TYPE Release)
  endif()
  add_compile_options(-Wall -Wextra)
endmacro()

# Another package's target has its plain name only where both are configured at once, which catkin build doesn't.
function(mapping_check_links)
  foreach(library ${ARGN})
    if(TARGET ${library} AND NOT library MATCHES "::")
      get_target_property(folder ${library} SOURCE_DIR)
      string(FIND "${folder}/" "${CMAKE_SOURCE_DIR}/" start)
      if(start EQUAL 0 AND NOT folder STREQUAL CMAKE_CURRENT_SOURCE_DIR)
        message(FATAL_ERROR "${PROJECT_NAME} links ${library} of another package: link PACKAGE::NAME or \${catkin_LIBRARIES}")
      endif()
    endif()
  endforeach()
endfunction()

# mapping_library(NAME SOURCES file... [PUBLIC library...] [PRIVATE library...]): the library PACKAGE_NAME, without ROS.
# Others who find_package() the package link PACKAGE::NAME; what is PUBLIC must be found by mapping_export_depends().
function(mapping_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  set(target ${PROJECT_NAME}_${name})
  add_library(${target} ${ARG_SOURCES})
  add_library(${PROJECT_NAME}::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(${target} PUBLIC cxx_std_17)
  target_include_directories(${target} PUBLIC
    $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:include>)
  mapping_check_links(${ARG_PUBLIC} ${ARG_PRIVATE})
  target_link_libraries(${target} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
  install(TARGETS ${target} EXPORT ${PROJECT_NAME}Targets
    ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    RUNTIME DESTINATION ${CATKIN_GLOBAL_BIN_DESTINATION})
  set_property(GLOBAL APPEND PROPERTY ${PROJECT_NAME}_TARGETS ${target})
endfunction()

# mapping_ros_library(NAME SOURCES file... [LINK library...]): the library PACKAGE_NAME, with all that catkin found.
function(mapping_ros_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  set(target ${PROJECT_NAME}_${name})
  add_library(${target} ${ARG_SOURCES})
  mapping_check_links(${ARG_LINK})
  target_link_libraries(${target} PUBLIC ${ARG_LINK} ${catkin_LIBRARIES})
  mapping_depend_on_messages(${target})
  install(TARGETS ${target}
    ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    RUNTIME DESTINATION ${CATKIN_GLOBAL_BIN_DESTINATION})
endfunction()

# mapping_tool(NAME SOURCES file... [LINK library...]): the program that rosrun calls NAME.
function(mapping_tool name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  set(target ${PROJECT_NAME}_${name})
  add_executable(${target} ${ARG_SOURCES})
  set_target_properties(${target} PROPERTIES OUTPUT_NAME ${name})
  mapping_check_links(${ARG_LINK})
  target_link_libraries(${target} PRIVATE ${ARG_LINK})
  mapping_depend_on_messages(${target})
  install(TARGETS ${target} RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
endfunction()

# mapping_gtest(NAME [SOURCES file...] [LINK library...] [DEFINITIONS name=value...] [TOOLS name...]): the test
# PACKAGE_test_NAME of test/test_NAME.cpp. TOOLS are programs of this package that it runs; each one's path is defined
# by its name in capitals. PACKAGE_DIR is this folder. Recordings that aren't part of the repository are looked for in
# DEFAULT_TEST_DATA_DIR, where the environment variable TEST_DATA_DIR doesn't name another folder.
function(mapping_gtest name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK;DEFINITIONS;TOOLS" ${ARGN})
  set(target ${PROJECT_NAME}_test_${name})
  mapping_check_links(${ARG_LINK})
  catkin_add_gtest(${target} test/test_${name}.cpp ${ARG_SOURCES})
  mapping_prepare_test(${target} "${ARG_LINK};gtest_main" "${ARG_DEFINITIONS}" "${ARG_TOOLS}")
endfunction()

# mapping_rostest(NAME [LINK ...] [DEFINITIONS ...] [TOOLS ...] [NODELETS library...]): the same for a test with a
# roscore, of test/test_NAME.test and test/test_NAME.cpp. NODELETS are libraries that the test has to be built after.
function(mapping_rostest name)
  cmake_parse_arguments(ARG "" "" "LINK;DEFINITIONS;TOOLS;NODELETS" ${ARGN})
  set(target ${PROJECT_NAME}_test_${name})
  mapping_check_links(${ARG_LINK})
  add_rostest_gtest(${target} test/test_${name}.test test/test_${name}.cpp)
  mapping_prepare_test(${target} "${ARG_LINK};${catkin_LIBRARIES}" "${ARG_DEFINITIONS}" "${ARG_TOOLS}")
  if(ARG_NODELETS)
    add_dependencies(${target} ${ARG_NODELETS})
  endif()
endfunction()

function(mapping_prepare_test target link definitions tools)
  target_link_libraries(${target} ${link} mapping_common::core)  # whose headers testing/... use
  get_filename_component(package_dir ${CMAKE_CURRENT_SOURCE_DIR} REALPATH)
  get_filename_component(data_dir ${package_dir}/../../shared/data ABSOLUTE)
  target_compile_definitions(${target} PRIVATE
    PACKAGE_DIR="${package_dir}" DEFAULT_TEST_DATA_DIR="${data_dir}" ${definitions})
  foreach(tool ${tools})
    string(TOUPPER ${tool} definition)
    target_compile_definitions(${target} PRIVATE ${definition}="$<TARGET_FILE:${PROJECT_NAME}_${tool}>")
    add_dependencies(${target} ${PROJECT_NAME}_${tool})
  endforeach()
  mapping_depend_on_messages(${target})
endfunction()

# Messages, services and configurations are generated before the target is built.
function(mapping_depend_on_messages target)
  set(generated ${${PROJECT_NAME}_EXPORTED_TARGETS} ${catkin_EXPORTED_TARGETS})
  if(generated)
    add_dependencies(${target} ${generated})
  endif()
endfunction()

# mapping_install(): installs headers, launch files, configurations and nodelets.xml, where there are any, and exports
# the libraries without ROS.
function(mapping_install)
  if(EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/include)
    install(DIRECTORY include/${PROJECT_NAME}/ DESTINATION ${CATKIN_PACKAGE_INCLUDE_DESTINATION})
  endif()
  foreach(folder launch config)
    if(EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/${folder})
      install(DIRECTORY ${folder} DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
    endif()
  endforeach()
  if(EXISTS ${CMAKE_CURRENT_SOURCE_DIR}/nodelets.xml)
    install(FILES nodelets.xml DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})
  endif()
  get_property(targets GLOBAL PROPERTY ${PROJECT_NAME}_TARGETS)
  if(targets)
    install(EXPORT ${PROJECT_NAME}Targets NAMESPACE ${PROJECT_NAME}::
      DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION}/cmake)
    export(EXPORT ${PROJECT_NAME}Targets NAMESPACE ${PROJECT_NAME}::
      FILE ${CATKIN_DEVEL_PREFIX}/share/${PROJECT_NAME}/cmake/${PROJECT_NAME}Targets.cmake)
  endif()
endfunction()
