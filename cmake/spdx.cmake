# A list of third-party parts in the format SPDX 2.3 (JSON): add_to_spdx() for each, then write_spdx(). Licences are as the
# packages name them, in comments: Debian's short names are not those of SPDX. The date is SOURCE_DATE_EPOCH where it is set.
set(spdx_packages "")
set(spdx_relationships "")

function(spdx_text result text)
  string(REPLACE "\\" "\\\\" text "${text}")
  string(REPLACE "\"" "\\\"" text "${text}")
  string(REGEX REPLACE "[\t\r\n]" " " text "${text}")
  set(${result} "${text}" PARENT_SCOPE)
endfunction()

function(add_to_spdx name version how licence)
  string(REGEX REPLACE "[^A-Za-z0-9.-]" "-" id "SPDXRef-${name}")
  foreach(field name version how licence)
    spdx_text(${field} "${${field}}")
  endforeach()
  set(fields "\"versionInfo\": \"${version}\", ")
  if(version STREQUAL "")
    set(fields "")
  endif()
  string(APPEND spdx_packages ",
    { \"SPDXID\": \"${id}\", \"name\": \"${name}\", ${fields}\"downloadLocation\": \"NOASSERTION\", \"filesAnalyzed\": false,
      \"licenseConcluded\": \"NOASSERTION\", \"licenseDeclared\": \"NOASSERTION\", \"copyrightText\": \"NOASSERTION\",
      \"licenseComments\": \"${licence}\", \"comment\": \"${how}\" }")
  set(kind DYNAMIC_LINK)
  if(how MATCHES "compiled in")
    set(kind STATIC_LINK)
  elseif(how MATCHES "report")
    set(kind CONTAINS)
  endif()
  string(APPEND spdx_relationships ",
    { \"spdxElementId\": \"SPDXRef-orbid\", \"relationshipType\": \"${kind}\", \"relatedSpdxElement\": \"${id}\" }")
  set(spdx_packages "${spdx_packages}" PARENT_SCOPE)
  set(spdx_relationships "${spdx_relationships}" PARENT_SCOPE)
endfunction()

function(write_spdx file version)
  string(SHA256 digest "${version}${spdx_packages}")
  string(TIMESTAMP date "%Y-%m-%dT%H:%M:%SZ" UTC)
  file(WRITE ${file} "{
  \"spdxVersion\": \"SPDX-2.3\",
  \"dataLicense\": \"CC0-1.0\",
  \"SPDXID\": \"SPDXRef-DOCUMENT\",
  \"name\": \"orbid-${version}\",
  \"documentNamespace\": \"https://spdx.org/spdxdocs/orbid-${version}-${digest}\",
  \"creationInfo\": { \"created\": \"${date}\", \"creators\": [\"Tool: orbid-cmake\"] },
  \"packages\": [
    { \"SPDXID\": \"SPDXRef-orbid\", \"name\": \"orbid\", \"versionInfo\": \"${version}\", \"downloadLocation\": \"NOASSERTION\",
      \"filesAnalyzed\": false, \"licenseConcluded\": \"BSD-3-Clause\", \"licenseDeclared\": \"BSD-3-Clause\",
      \"copyrightText\": \"NOASSERTION\" }${spdx_packages}
  ],
  \"relationships\": [
    { \"spdxElementId\": \"SPDXRef-DOCUMENT\", \"relationshipType\": \"DESCRIBES\", \"relatedSpdxElement\": \"SPDXRef-orbid\" }${spdx_relationships}
  ]
}
")
endfunction()
