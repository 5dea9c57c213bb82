# name@experiment in a comment is a name; Doxygen would take it for a command.
s/([[:alnum:]_])@/\1\\@/g
