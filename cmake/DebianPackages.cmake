# Debian packages, by `tools/make_packages` (cpack -G DEB in a build that is configured for /usr):
#   cairn          the command line, the default vocabulary, schemas, documents, manual pages
#   cairnd         the map server, its unit for systemd, /etc/cairn/cairnd.yaml
#   libcairn0      the client library, named by its soname
#   libcairn-dev   headers, CMake package, pkg-config file, examples
set(library_package libcairn${PROJECT_VERSION_MAJOR})
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME cairn)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "The Cairn authors <cairn@localhost>")
set(CPACK_COMPONENTS_ALL cairn cairnd libcairn libcairn-dev)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_STRIP_FILES ON)
# Paths as they were configured: /etc lies outside of /usr.
set(CPACK_SET_DESTDIR ON)
set(CPACK_INSTALL_PREFIX ${CMAKE_INSTALL_PREFIX})
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_CAIRN_PACKAGE_NAME cairn)
set(CPACK_DEBIAN_CAIRN_DESCRIPTION "maps of places, and where a camera is in them
 From a camera stream to a persistent sparse map in one file, and from an image back to a pose: the command line.")
set(CPACK_DEBIAN_CAIRND_PACKAGE_NAME cairnd)
set(CPACK_DEBIAN_CAIRND_PACKAGE_SECTION net)
set(CPACK_DEBIAN_CAIRND_PACKAGE_DEPENDS "cairn (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_CAIRND_DESCRIPTION "map server: where is this camera?
 Serves a directory of Cairn's maps over gRPC and HTTP: robots, phones and web pages localize, track, follow and extend
 them.")
set(CPACK_DEBIAN_LIBCAIRN_PACKAGE_NAME ${library_package})
set(CPACK_DEBIAN_LIBCAIRN_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_LIBCAIRN_PACKAGE_SHLIBS "libcairn ${PROJECT_VERSION_MAJOR} ${library_package} (>= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_LIBCAIRN_DESCRIPTION "client library of Cairn's maps
 Localizes images and tracks cameras in maps, from files and servers, for C++ and C.")
set(CPACK_DEBIAN_LIBCAIRN-DEV_PACKAGE_NAME libcairn-dev)
set(CPACK_DEBIAN_LIBCAIRN-DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_LIBCAIRN-DEV_PACKAGE_DEPENDS "${library_package} (= ${PROJECT_VERSION}), libabsl-dev")
set(CPACK_DEBIAN_LIBCAIRN-DEV_DESCRIPTION "client library of Cairn's maps: to build programs with it
 Headers for C++ and C, a CMake package, a pkg-config file and examples.")

set(debian ${CMAKE_CURRENT_LIST_DIR}/debian)
set(CPACK_DEBIAN_CAIRND_PACKAGE_CONTROL_EXTRA ${debian}/conffiles ${debian}/postinst ${debian}/prerm ${debian}/postrm)
set(CPACK_DEBIAN_LIBCAIRN_PACKAGE_CONTROL_EXTRA ${debian}/triggers)
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr")
  install(FILES server/daemon/cairnd.yaml DESTINATION /etc/cairn COMPONENT cairnd)
  foreach(pair cairn:cairn cairnd:cairnd libcairn:${library_package} libcairn-dev:libcairn-dev)
    string(REPLACE ":" ";" pair ${pair})
    list(GET pair 0 component)
    list(GET pair 1 package)
    install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} RENAME copyright COMPONENT ${component})
  endforeach()
endif()
include(CPack)
