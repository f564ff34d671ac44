/// \file
/// The version of these headers, for C and C++. cairn_version() (cairn.h) is that of the library that is loaded.
#ifndef CAIRN_VERSION_H_
#define CAIRN_VERSION_H_

#define CAIRN_VERSION_MAJOR 0 /**< Changes when programs have to be changed. */
#define CAIRN_VERSION_MINOR 1 /**< While the major version is 0: changes when programs have to be compiled again. */
#define CAIRN_VERSION_PATCH 0 /**< Changes when neither is needed. */
#define CAIRN_VERSION "0.1.0" /**< All three. */

#endif
