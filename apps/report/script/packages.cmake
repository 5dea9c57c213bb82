# Puts the packages of the lock file into the build tree. Their install scripts do not run; esbuild comes as a program
# in a package of its own.
file(COPY ${FROM}/package.json ${FROM}/package-lock.json DESTINATION ${TO})
execute_process(
  COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund --loglevel=error
  WORKING_DIRECTORY ${TO} RESULT_VARIABLE failed OUTPUT_QUIET ERROR_VARIABLE said)
if(failed)
  message(FATAL_ERROR "npm could not fetch the packages of report.html:\n${said}"
    "Without npm's registry, configure with -DORBID_REPORT_SCRIPTS=OFF: reports then hold still pictures.")
endif()
file(TOUCH ${TO}/packages.stamp)
