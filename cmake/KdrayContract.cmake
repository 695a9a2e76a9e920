# SPDX-License-Identifier: Apache-2.0
# The names that api/openapi.yaml lists, as C++, so that each of them is written once.

set(KDRAY_CONTRACT "${PROJECT_SOURCE_DIR}/api/openapi.yaml")
set(KDRAY_CONTRACT_NAMES_SCRIPT "${CMAKE_CURRENT_LIST_DIR}/contract_names.py")

# kdray_contract_names(TARGET NAME FORM enums|help HEADER path/to/name.h NAMESPACE kdray::layer
#                      NAMES Enum=/json/pointer...)
#
# Generates HEADER, which TARGET and those who link it include under that name. FORM and NAMES are explained in the script.
function(kdray_contract_names)
  cmake_parse_arguments(arg "" "TARGET;FORM;HEADER;NAMESPACE" "NAMES" ${ARGN})
  foreach(needed TARGET FORM HEADER NAMESPACE NAMES)
    if(NOT arg_${needed})
      message(FATAL_ERROR "kdray_contract_names: ${needed} is missing")
    endif()
  endforeach()
  set(root "${CMAKE_CURRENT_BINARY_DIR}/contract")
  set(header "${root}/${arg_HEADER}")
  cmake_path(GET header PARENT_PATH folder)
  file(MAKE_DIRECTORY "${folder}")
  add_custom_command(
    OUTPUT "${header}"
    COMMAND "${KDRAY_PYTHON}" "${KDRAY_CONTRACT_NAMES_SCRIPT}" ${arg_FORM} "${KDRAY_CONTRACT}" "${header}"
            ${arg_NAMESPACE} ${arg_NAMES}
    DEPENDS "${KDRAY_CONTRACT}" "${KDRAY_CONTRACT_NAMES_SCRIPT}"
    COMMENT "Writing ${arg_HEADER} from the contract"
    VERBATIM)
  target_sources(${arg_TARGET} PRIVATE "${header}")
  target_include_directories(${arg_TARGET} PUBLIC "${root}")
endfunction()
