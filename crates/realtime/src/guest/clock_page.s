# Clocks without a call, and reads of ports without one. Data behind it, see clock_page.rs:
#   0 time, 8 limit, 16 cost, 24 looks, 32 calls left, 40 calls of a turn, 48 known files,
#   56 ports, 64 reads, 72 selects, 80 counts of bytes since the last of these, 88 all counts; 96
#   ports of 552 bytes each: file, whether a read waits, time from which nothing is known, bytes,
#   bytes taken, then 64 of time << 8 | byte; 2304 reads: time << 10 | port << 8 | bytes; 2816
#   counts: time << 10 | port << 8 | bytes, address; 2928 files that take bytes; 2936 of select.
        .text
        .set    DATA, start + 4096
start:
clock_gettime:                  # edi: clock, rsi: timespec
        movabs  $1767225600000000000, %rcx
        test    %edi, %edi
        je      1f
        movabs  $1000000000000, %rcx
        cmp     $1, %edi
        je      1f
        cmp     $4, %edi
        je      1f
        cmp     $6, %edi
        je      1f
        cmp     $7, %edi
        je      1f
        jmp     2f
1:      call    look
        jc      2f
        mov     %rax, (%rsi)
        mov     %rdx, 8(%rsi)
        xor     %eax, %eax
        ret
2:      mov     $228, %eax
        syscall
        ret
gettimeofday:                   # rdi: timeval, rsi: zone
        test    %rsi, %rsi
        jne     3f
        test    %rdi, %rdi
        je      3f
        movabs  $1767225600000000000, %rcx
        call    look
        jc      3f
        mov     %rax, (%rdi)
        mov     %rdx, %rax
        xor     %edx, %edx
        mov     $1000, %r9d
        div     %r9
        mov     %rax, 8(%rdi)
        xor     %eax, %eax
        ret
3:      mov     $96, %eax
        syscall
        ret
time:                           # rdi: time_t or nothing
        movabs  $1767225600000000000, %rcx
        call    look
        jc      5f
        test    %rdi, %rdi
        je      4f
        mov     %rax, (%rdi)
4:      ret
5:      mov     $201, %eax
        syscall
        ret
clock_getres:
        mov     $229, %eax
        syscall
        ret
getcpu:
        mov     $309, %eax
        syscall
        ret
getrandom:                      # ENOSYS: the caller makes the call
        mov     $-38, %rax
        ret
look:                           # rcx: what the clock showed at 0; rax, rdx: s, ns; or carry
        lea     DATA(%rip), %r8
        mov     (%r8), %rax
        add     16(%r8), %rax
        cmp     8(%r8), %rax
        ja      6f
        decq    32(%r8)
        js      6f
        mov     %rax, (%r8)
        incq    24(%r8)
        add     %rcx, %rax
        xor     %edx, %edx
        mov     $1000000000, %r9d
        div     %r9
        clc
        ret
6:      stc
        ret
serve:                          # eax: number of a call; rax: its answer, or carry: make the call
        push    %rbx
        push    %rdx
        push    %rsi
        push    %rdi
        push    %r8
        push    %r9
        push    %r10
        push    %r12
        push    %r13
        push    %r14
        push    %r15
        push    %rbp
served: lea     DATA(%rip), %r11
        mov     (%r11), %rcx
        add     16(%r11), %rcx          # rcx: time of the answer
        cmp     8(%r11), %rcx
        ja      give_up
        mov     32(%r11), %r14          # r14: calls left behind it
        dec     %r14
        js      give_up
        test    %eax, %eax
        je      read
        cmp     $16, %eax
        je      ask
        cmp     $270, %eax
        je      select
give_up:
        stc
        jmp     leave
read:                           # edi: file, rsi: buffer, rdx: length
        test    %rdx, %rdx
        je      give_up
        cmpq    $64, 64(%r11)
        jae     give_up
        call    find
        jc      give_up
        xor     %edi, %edi              # rdi: bytes so far
3:      mov     32(%rbx), %rax
        add     %rdi, %rax
        cmp     24(%rbx), %rax
        jae     4f
        mov     40(%rbx,%rax,8), %rax
        mov     %rax, %r8
        shr     $8, %r8                 # r8: when the next byte comes
        cmp     %rcx, %r8
        ja      5f
        mov     %al, (%rsi,%rdi)
        inc     %rdi
        cmp     %rdx, %rdi
        jb      3b
        jmp     has_read
4:      cmp     16(%rbx), %rcx          # all known bytes are taken
        jae     give_up
        test    %rdi, %rdi
        je      give_up
        jmp     has_read
5:      test    %rdi, %rdi
        jne     has_read
        cmpq    $0, 8(%rbx)
        je      give_up
        cmp     8(%r11), %r8
        ja      give_up
        mov     %r8, %rcx               # it waits, and has a new turn
        mov     40(%r11), %r14
        jmp     3b
has_read:
        mov     64(%r11), %rax
        mov     %rcx, %rdx
        shl     $10, %rdx
        shl     $8, %r12
        or      %r12, %rdx
        or      %rdi, %rdx
        mov     %rdx, 2304(%r11,%rax,8)
        incq    64(%r11)
        movq    $0, 80(%r11)
        add     %rdi, 32(%rbx)
        mov     %rcx, (%r11)
        mov     %r14, 32(%r11)
        mov     %rdi, %rax
        clc
        jmp     leave
ask:                            # edi: file, esi: request, rdx: where the count goes
        cmp     $0x541B, %esi
        jne     give_up
        cmpq    $7, 80(%r11)
        jae     give_up
        call    find
        jc      give_up
        xor     %edi, %edi              # rdi: bytes that are there
1:      mov     32(%rbx), %rax
        add     %rdi, %rax
        cmp     24(%rbx), %rax
        jae     2f
        mov     40(%rbx,%rax,8), %rax
        shr     $8, %rax
        cmp     %rcx, %rax
        ja      3f
        inc     %rdi
        jmp     1b
2:      cmp     16(%rbx), %rcx          # there may be more
        jae     give_up
3:      mov     %edi, (%rdx)
        mov     80(%r11), %rax
        shl     $4, %rax
        mov     %rdx, 2824(%r11,%rax)
        mov     %rcx, %rdx
        shl     $10, %rdx
        shl     $8, %r12
        or      %r12, %rdx
        or      %rdi, %rdx
        mov     %rdx, 2816(%r11,%rax)
        incq    80(%r11)
        incq    88(%r11)
        mov     %rcx, (%r11)
        mov     %r14, 32(%r11)
        xor     %eax, %eax
        jmp     leave
find:                           # edi: file; rbx, r12: the port, or carry
        lea     96(%r11), %rbx
        xor     %r12d, %r12d
1:      cmp     56(%r11), %r12
        jae     2f
        cmp     (%rbx), %edi
        je      3f
        add     $552, %rbx
        inc     %r12
        jmp     1b
2:      stc
        ret
3:      clc
        ret
select:                         # edi: files, rsi, rdx, r10: sets, r8: timespec, r9: signals
        test    %r9, %r9
        jne     give_up
        test    %rsi, %rsi
        je      give_up
        lea     -1(%rdi), %eax
        cmp     $62, %eax
        ja      give_up
        test    %r10, %r10
        je      1f
        cmpq    $0, (%r10)
        jne     give_up
1:      mov     %edi, %edi
        xor     %eax, %eax
        bts     %rdi, %rax
        dec     %rax
        mov     %rdx, %rbp              # rbp: the set of files to write to, or 0
        xor     %edi, %edi
        test    %rdx, %rdx
        je      2f
        mov     (%rdx), %rdi
        and     %rax, %rdi
        mov     2928(%r11), %r12        # all of them take bytes
        not     %r12
        test    %rdi, %r12
        jne     give_up
2:      mov     %rdi, 2936(%r11)
        mov     (%rsi), %rdx            # rdx: the files to read
        and     %rax, %rdx
        or      %rdx, %rdi
        je      give_up
        mov     48(%r11), %rax
        not     %rax
        test    %rdx, %rax
        jne     give_up
        movabs  $0x7fffffffffffffff, %r13
        test    %r8, %r8                # r13: end of its time
        je      3f
        mov     (%r8), %rax
        cmp     $1000000000, %rax
        jae     give_up
        imul    $1000000000, %rax, %r13
        mov     8(%r8), %rax
        cmp     $1000000000, %rax
        jae     give_up
        add     %rax, %r13
        add     %rcx, %r13
3:      xor     %edi, %edi              # rdi: files that are ready
        movabs  $0x7fffffffffffffff, %r12
        mov     %r12, %r15              # r12: next byte, r15: nothing is known from then on
        lea     96(%r11), %rbx
        mov     56(%r11), %r9
4:      test    %r9, %r9
        je      7f
        dec     %r9
        mov     (%rbx), %eax
        bt      %rax, %rdx
        jnc     6f
        mov     32(%rbx), %r10
        cmp     24(%rbx), %r10
        jae     5f
        mov     40(%rbx,%r10,8), %r10
        shr     $8, %r10
        cmp     %rcx, %r10
        ja      8f
        bts     %rax, %rdi
        jmp     6f
8:      cmp     %r12, %r10
        cmovb   %r10, %r12
        jmp     6f
5:      mov     16(%rbx), %r10
        cmp     %r15, %r10
        cmovb   %r10, %r15
6:      add     $552, %rbx
        jmp     4b
7:      cmp     %r15, %rcx
        jae     give_up
        mov     %rdi, %rax
        or      2936(%r11), %rax
        jne     9f
        cmp     %r15, %r12
        jae     give_up
        cmp     8(%r11), %r12
        ja      give_up
        cmp     %r13, %r12
        jae     give_up
        mov     %r12, %rcx              # it waits, and has a new turn
        mov     40(%r11), %r14
        jmp     3b
9:      mov     %rdi, (%rsi)
        test    %r8, %r8
        je      1f
        mov     %r13, %rax
        sub     %rcx, %rax
        xor     %edx, %edx
        mov     $1000000000, %r9d
        div     %r9
        mov     %rax, (%r8)
        mov     %rdx, 8(%r8)
1:      popcnt  %rdi, %rax
        test    %rbp, %rbp
        je      2f
        mov     2936(%r11), %rdx
        mov     %rdx, (%rbp)
        popcnt  %rdx, %rdx
        add     %rdx, %rax
2:      incq    72(%r11)
        movq    $0, 80(%r11)
        mov     %rcx, (%r11)
        mov     %r14, 32(%r11)
        clc
leave:
        pop     %rbp
        pop     %r15
        pop     %r14
        pop     %r13
        pop     %r12
        pop     %r10
        pop     %r9
        pop     %r8
        pop     %rdi
        pop     %rsi
        pop     %rdx
        pop     %rbx
        ret
