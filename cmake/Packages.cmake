# Debian packages of this build: unlidar-track has the program and what a station needs, libunlidar-dev
# the C++ API. tools/package.sh makes them.

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "unlidar_track contributors <unlidar-track@packages.invalid>")
set(CPACK_STRIP_FILES ON)
set(CPACK_SET_DESTDIR ON)  # the files of /etc and of systemd have absolute names
set(CPACK_INSTALL_PREFIX /usr)

set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_COMPONENTS_ALL runtime runtime_package development development_package)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME unlidar-track)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS adduser)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS "bash-completion, logrotate, libunlidar-dev")
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION "A static ground station with one or more LiDARs
watches the sky. This program reads their frames, or the packets of Livox
LiDARs, finds the drones in them and writes their trajectories with standard
deviations. A service for systemd is part of the package.")
set(packaging ${CMAKE_CURRENT_SOURCE_DIR}/packaging)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_CONTROL_EXTRA
  ${packaging}/conffiles ${packaging}/postinst ${packaging}/prerm ${packaging}/postrm)

set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libunlidar-dev)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_DEPENDS
  "libceres-dev, libeigen3-dev, libyaml-cpp-dev")
set(CPACK_DEBIAN_LIBRARY_DESCRIPTION "The C++ API of unlidar-track, a static library and its
headers: frames of static LiDARs go in, tracks of drones come out. CMake finds
it by find_package(unlidar_track).")

# What hand-made installs have no use for: each component is installed where it is named.
function(install_in_package component destination file)
  install(FILES ${file} DESTINATION ${destination} COMPONENT ${component} EXCLUDE_FROM_ALL ${ARGN})
endfunction()
set(made ${CMAKE_CURRENT_BINARY_DIR}/packaging)
install_in_package(runtime_package /etc/unlidar packaging/station.yaml)
install_in_package(runtime_package /etc/logrotate.d packaging/logrotate RENAME unlidar-track)
install_in_package(runtime_package /lib/systemd/system packaging/unlidar-track.service)
install_in_package(runtime_package share/man/man1 ${made}/unlidar_track.1.gz)
install_in_package(runtime_package share/bash-completion/completions packaging/bash-completion
  RENAME unlidar_track)
install_in_package(runtime_package share/doc/unlidar-track LICENSE RENAME copyright)
install_in_package(runtime_package share/doc/unlidar-track ${made}/changelog.gz)
install_in_package(development_package share/doc/libunlidar-dev LICENSE RENAME copyright)
install_in_package(development_package share/doc/libunlidar-dev ${made}/changelog.gz)

string(TIMESTAMP package_date "%a, %d %b %Y %H:%M:%S +0000" UTC)
configure_file(packaging/changelog.in ${made}/changelog @ONLY)
find_program(HELP2MAN help2man)
add_custom_command(OUTPUT ${made}/unlidar_track.1.gz ${made}/changelog.gz
  COMMAND ${HELP2MAN} --no-info --include ${packaging}/unlidar_track.h2m --output unlidar_track.1
    $<TARGET_FILE:unlidar_track>
  COMMAND gzip --best --no-name --force --keep unlidar_track.1 changelog
  DEPENDS unlidar_track ${packaging}/unlidar_track.h2m ${made}/changelog
  WORKING_DIRECTORY ${made}
  VERBATIM)
add_custom_target(package_files DEPENDS ${made}/unlidar_track.1.gz unlidar_core)

include(CPack)
cpack_add_component(runtime GROUP program)
cpack_add_component(runtime_package GROUP program)
cpack_add_component(development GROUP library)
cpack_add_component(development_package GROUP library)
