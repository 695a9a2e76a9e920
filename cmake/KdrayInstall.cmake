# SPDX-License-Identifier: Apache-2.0
# What `cmake --install` puts where, and the Debian packages that cpack makes of it.
#
# Components: `kdray` is the service and the command, `dev` the C++ client library.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

install(TARGETS kdrayd kdray RUNTIME COMPONENT kdray)

# ---- the library ----
set(config_dir "${CMAKE_INSTALL_LIBDIR}/cmake/kdray")
install(TARGETS kdray_client EXPORT kdray ARCHIVE COMPONENT dev)
install(DIRECTORY clients/cpp/client/include/kdray DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}" COMPONENT dev)
install(EXPORT kdray NAMESPACE kdray:: FILE kdray-targets.cmake DESTINATION "${config_dir}" COMPONENT dev)
configure_package_config_file(package/kdray-config.cmake.in "${PROJECT_BINARY_DIR}/kdray-config.cmake"
  INSTALL_DESTINATION "${config_dir}")
write_basic_package_version_file("${PROJECT_BINARY_DIR}/kdray-config-version.cmake" COMPATIBILITY SameMinorVersion)
install(FILES "${PROJECT_BINARY_DIR}/kdray-config.cmake" "${PROJECT_BINARY_DIR}/kdray-config-version.cmake"
  DESTINATION "${config_dir}" COMPONENT dev)

# ---- manual pages and completions, made by the programs themselves ----
find_program(KDRAY_GZIP gzip REQUIRED)
set(documents "${PROJECT_BINARY_DIR}/documents")
file(MAKE_DIRECTORY "${documents}")
set(manual_script "${CMAKE_CURRENT_LIST_DIR}/manual_of_help.py")
add_custom_command(
  OUTPUT "${documents}/kdray.1.gz" "${documents}/kdrayd.8.gz"
  COMMAND kdray man > "${documents}/kdray.1"
  COMMAND "${KDRAY_PYTHON}" "${manual_script}" $<TARGET_FILE:kdrayd> "${documents}/kdrayd.8"
  COMMAND "${KDRAY_GZIP}" -9nf "${documents}/kdray.1" "${documents}/kdrayd.8"
  DEPENDS kdray kdrayd "${manual_script}"
  COMMENT "Writing the manual pages")
add_custom_command(
  OUTPUT "${documents}/kdray.bash" "${documents}/kdray.zsh" "${documents}/kdray.fish"
  COMMAND kdray completion bash > "${documents}/kdray.bash"
  COMMAND kdray completion zsh > "${documents}/kdray.zsh"
  COMMAND kdray completion fish > "${documents}/kdray.fish"
  DEPENDS kdray
  COMMENT "Writing the completions")
add_custom_target(documents ALL DEPENDS "${documents}/kdray.1.gz" "${documents}/kdray.bash")

install(FILES "${documents}/kdray.1.gz" DESTINATION "${CMAKE_INSTALL_MANDIR}/man1" COMPONENT kdray)
install(FILES "${documents}/kdrayd.8.gz" DESTINATION "${CMAKE_INSTALL_MANDIR}/man8" COMPONENT kdray)
# Where Debian's shells look.
install(FILES "${documents}/kdray.bash" RENAME kdray
  DESTINATION "${CMAKE_INSTALL_DATADIR}/bash-completion/completions" COMPONENT kdray)
install(FILES "${documents}/kdray.zsh" RENAME _kdray
  DESTINATION "${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions" COMPONENT kdray)
install(FILES "${documents}/kdray.fish"
  DESTINATION "${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d" COMPONENT kdray)

# ---- the service ----
# The unit names the folders that it is installed to, and `cmake --install --prefix` may still change them: so it is written then.
set(unit_template "${PROJECT_SOURCE_DIR}/package/kdrayd.service.in")
set(unit "${PROJECT_BINARY_DIR}/kdrayd.service")
set(defaults "${PROJECT_SOURCE_DIR}/package/kdrayd.default")
install(CODE "
  set(KDRAY_BINDIR \"\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_BINDIR}\")
  set(KDRAY_SYSCONFDIR \"\${CMAKE_INSTALL_PREFIX}/etc\")
  if(CMAKE_INSTALL_PREFIX STREQUAL \"/usr\")
    set(KDRAY_SYSCONFDIR /etc)
  endif()
  configure_file(\"${unit_template}\" \"${unit}\" @ONLY)
  file(INSTALL \"${unit}\" DESTINATION \"\${CMAKE_INSTALL_PREFIX}/lib/systemd/system\")
  file(INSTALL \"${defaults}\" DESTINATION \"\${KDRAY_SYSCONFDIR}/default\" RENAME kdrayd)
" COMPONENT kdray)
install(FILES package/sysusers.conf RENAME kdray.conf DESTINATION lib/sysusers.d COMPONENT kdray)

install(FILES README.md package/copyright DESTINATION "${CMAKE_INSTALL_DOCDIR}" COMPONENT kdray)
install(FILES package/haproxy.cfg DESTINATION "${CMAKE_INSTALL_DOCDIR}/examples" COMPONENT kdray)
install(FILES package/copyright DESTINATION "${CMAKE_INSTALL_DATADIR}/doc/libkdray-dev" COMPONENT dev)

# ---- what changed, under the names that Debian gives these files ----
file(STRINGS CHANGELOG.md released REGEX "^## ${PROJECT_VERSION} [(]")
string(REGEX REPLACE ".*[(](.*)[)].*" "\\1" released "${released}")
execute_process(COMMAND date -u -R -d "${released}" OUTPUT_VARIABLE released OUTPUT_STRIP_TRAILING_WHITESPACE)
set(debian_release "")
if(EXISTS /etc/os-release)
  file(STRINGS /etc/os-release debian_release REGEX "^VERSION_ID=")
  string(REGEX REPLACE "[^0-9.]" "" debian_release "${debian_release}")
endif()
# The release of Debian is part of the package's version, because its dependencies are those of that release.
set(package_release "1+deb${debian_release}")
file(WRITE "${documents}/changelog.Debian"
  "kdray (${PROJECT_VERSION}-${package_release}) unstable; urgency=medium\n\n  * changelog.gz says what changed.\n\n"
  " -- kdray authors <kdray@example.org>  ${released}\n")
add_custom_command(
  OUTPUT "${documents}/changelog.gz" "${documents}/changelog.Debian.gz"
  COMMAND "${KDRAY_GZIP}" -9nkf "${documents}/changelog.Debian"
  COMMAND "${KDRAY_GZIP}" -9nc "${PROJECT_SOURCE_DIR}/CHANGELOG.md" > "${documents}/changelog.gz"
  DEPENDS "${PROJECT_SOURCE_DIR}/CHANGELOG.md" "${documents}/changelog.Debian"
  COMMENT "Writing the changelogs of the packages")
add_custom_target(changelogs ALL DEPENDS "${documents}/changelog.gz")
foreach(package IN ITEMS kdray libkdray-dev)
  string(REGEX REPLACE "^lib.*-" "" component ${package})
  install(FILES "${documents}/changelog.gz" "${documents}/changelog.Debian.gz"
    DESTINATION "${CMAKE_INSTALL_DATADIR}/doc/${package}" COMPONENT ${component})
endforeach()

# ---- Debian packages: cpack --preset package ----
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME kdray)
set(CPACK_PACKAGE_CONTACT "kdray authors <kdray@example.org>")
set(CPACK_SET_DESTDIR ON)       # /etc is not below /usr
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL kdray dev)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE "${package_release}")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_KDRAY_PACKAGE_NAME kdray)
set(CPACK_DEBIAN_KDRAY_PACKAGE_SECTION science)
set(CPACK_DEBIAN_KDRAY_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_KDRAY_PACKAGE_DEPENDS passwd)
# For a shared store by HTTPS.
set(CPACK_DEBIAN_KDRAY_PACKAGE_RECOMMENDS ca-certificates)
set(CPACK_DEBIAN_KDRAY_PACKAGE_SUGGESTS "haproxy, libkdray-dev")
set(CPACK_COMPONENT_KDRAY_DESCRIPTION "ray queries and renders over triangle meshes
The daemon kdrayd answers ray and point queries over triangle meshes and
renders them, by HTTP. The command kdray uploads meshes and asks it.")
set(CPACK_DEBIAN_KDRAY_PACKAGE_CONTROL_EXTRA
  "${PROJECT_SOURCE_DIR}/package/deb/postinst;${PROJECT_SOURCE_DIR}/package/deb/prerm;${PROJECT_SOURCE_DIR}/package/deb/postrm;${PROJECT_SOURCE_DIR}/package/deb/conffiles")
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libkdray-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "libcpp-httplib-dev, libssl-dev, pkg-config")
set(CPACK_COMPONENT_DEV_DESCRIPTION "client library of kdray for C++
Headers, a static library and a CMake configuration: find_package(kdray).")
include(CPack)
